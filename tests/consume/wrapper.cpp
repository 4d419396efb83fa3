// SPDX-License-Identifier: MIT
// dahl.hpp against the C calls: the same bits, known sizes, and static objects without constructors at start.
#include <dahl.hpp> // without a node; then with one
#include <dahl_node.h>
#include <dahl.hpp>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <type_traits>

static_assert(dahl::state_size == 8, "the state of one bearing");
static_assert(dahl::plan_size == sizeof(dahl::Plan) && dahl::encoder_size == sizeof(dahl::Encoder), "the wrapper adds no member");
static_assert(sizeof(dahl::Bearing) == dahl::state_size + 8 || sizeof(void *) != 8, "a state and a pointer");
static_assert(std::is_trivially_destructible<dahl::Bearing>::value && std::is_trivially_copyable<dahl::Bearing>::value, "");
static_assert(std::is_standard_layout<dahl::Plan>::value && std::is_trivially_copyable<dahl::Encoder>::value, "");

static_assert(sizeof(dahl::CompensatorPlan) == sizeof(dahl_compensator_plan_t) && sizeof(dahl::Node) == sizeof(dahl_node_t), "");
struct PointerAndState { const void *plan; dahl_compensator_t state; };
static_assert(sizeof(dahl::Compensator) == sizeof(PointerAndState), "");
static_assert(std::is_trivially_copyable<dahl::Compensator>::value && std::is_trivially_destructible<dahl::Node>::value, "");

static dahl::Plan plan, softer;
static dahl::CompensatorPlan compensation;
static dahl::Compensator compensator(compensation);
static dahl::Node node;
static dahl::Bearing bearing(plan);
static dahl::Encoder encoder;
constexpr dahl::Plan zeros; // constant, so no code runs for it at start

static std::uint32_t random_word()
{
    static std::uint32_t word = 1;
    word = word * 1664525u + 1013904223u;
    return word >> 8;
}

static bool same(float a, float b)
{
    return !(a < b) && !(b < a);
}

// Defaults: sign forward, no step limit, a counter of 32 bits, no count.
static bool defaults_are_those_of_the_header()
{
    dahl::Plan by_angle;
    dahl::Encoder any;
    if (by_angle.prepare(100.0f, 0.5f) != DAHL_OK || any.init(65536) != DAHL_OK) {
        return false;
    }
    dahl::Bearing shaft(by_angle);
    any.home(10);
    return any.move(20010) == 20000 && any.jumps() == 0 && dahl::counts_between(0xFFFFFFFFu, 1) == 2 &&
           same(shaft.step_counts(1000), 0.0f) && shaft.step(-1e-3f) < -0.05f;
}

static dahl_compensator_params_t compensator_params()
{
    dahl_compensator_params_t p = {};
    p.friction = {100.0f, 0.5f, 6.2831853f / 16384};
    p.law = DAHL_COMPENSATOR_REFERENCE;
    p.gain = 0.9f, p.limit = 0.4f, p.slew = 50.0f, p.period = 1e-3f, p.rise = 0.1f, p.fall = 0.02f;
    p.play = 2, p.jump = 300;
    return p;
}

// The bearing is stepped by a reference, and the observer adds to its torque.
static bool compensator_has_the_bits_of_c()
{
    dahl_compensator_params_t good = compensator_params(), bad = good;
    bad.period = -1.0f;
    dahl_compensator_plan_t c_plan = {};
    dahl_compensator_t c_compensator = {};
    dahl_plan_t c_friction;
    dahl_state_t c_state = {};
    if (compensation.prepare(good) != DAHL_COMPENSATOR_OK || dahl_compensator_prepare(&c_plan, &good) != DAHL_COMPENSATOR_OK ||
        compensation.prepare(bad) == DAHL_COMPENSATOR_OK || dahl_prepare(&c_friction, &good.friction) != DAHL_OK) {
        return false;
    }
    dahl::Bearing reference(c_friction);
    dahl::Compensator again(c_plan);
    const dahl_residual_params_t observer = {0.002f, 15.0f, 0.4f, 0.4f, 0.0f, 1, 1};
    dahl::ResidualPlan residual_plan, other_residual_plan;
    dahl::Residual residual(residual_plan), same_residual(residual_plan.c());
    dahl_residual_t c_residual = {};
    dahl_compensator_params_t other = good;
    other.gain = 0.5f, other.play = 4, other.friction.Fc = 0.4f;
    if (residual_plan.prepare(good, observer) != DAHL_COMPENSATOR_OK ||
        other_residual_plan.prepare(other, observer) != DAHL_COMPENSATOR_OK) {
        return false;
    }
    const dahl_residual_plan_t *c_residual_plan = &residual_plan.c();
    dahl_compensator_plan_t other_plan = {};
    if (dahl_compensator_prepare(&other_plan, &other) != DAHL_COMPENSATOR_OK) {
        return false;
    }
    for (int tick = 0; tick < 3000; tick++) {
        const std::int32_t moved = static_cast<std::int32_t>(random_word() % 700) - 350;
        const bool is_good = random_word() % 8 != 0;
        const std::int32_t behind = dahl_compensator_move(&c_plan, &c_compensator, moved, is_good);
        if (compensator.move(moved, is_good) != behind || again.move(moved, is_good) != behind) {
            return false;
        }
        const std::int32_t w = dahl_step_counts_q30(&c_friction, &c_state, moved);
        if (reference.step_counts_q30(moved) != w || compensator.torque(w) != dahl_compensator_torque(&c_plan, &c_compensator, w)) {
            return false;
        }
        const float torque = 1e-3f * static_cast<float>(moved);
        const std::int32_t r = dahl_residual_torque(c_residual_plan, &c_residual, &c_compensator, moved);
        dahl_residual_note(&c_residual, dahl_residual_q24(c_residual_plan, torque));
        if (residual.torque(compensator, moved) != r || same_residual.torque(again, moved) != r) {
            return false;
        }
        residual.note(torque), same_residual.note_q24(residual.state().unexplained_q24[0]);
        if (tick == 1500) {
            residual.change(other_residual_plan), same_residual.change(other_residual_plan.c());
            dahl_residual_change(c_residual_plan, &other_residual_plan.c(), &c_residual);
            c_residual_plan = &other_residual_plan.c();
            compensator.change(other_plan), again.change(other_plan);
            dahl_compensator_change(&c_plan, &other_plan, &c_compensator);
            c_plan = other_plan;
        }
    }
    return compensator.state().rejected == c_compensator.rejected && c_compensator.rejected > 100;
}

static bool same_frames(const dahl_can_frame_t &a, const dahl_can_frame_t &b)
{
    return a.id == b.id && a.length == b.length && std::memcmp(a.data, b.data, sizeof a.data) == 0;
}

static bool node_has_the_frames_of_c()
{
    const dahl_params_t good = {100.0f, 0.5f, 6.2831853f / 16384}, bad = {-1.0f, 0.5f, 1.0f};
    static dahl_node_t c_node;
    if (node.init(good, 3) != DAHL_OK || dahl_node_init(&c_node, &good, 3) != DAHL_OK || node.init(bad) != DAHL_ERR_PARAM) {
        return false;
    }
    int answers = 0;
    for (std::uint32_t tick = 0; tick < 1000; tick++) {
        dahl_can_frame_t in, out = {}, c_out = {};
        dahl_encoder_state_t angle = {};
        angle.count = static_cast<std::int32_t>(random_word() % 64), angle.counter = tick % 16, angle.valid = true;
        dahl_frames_pack_encoder(&in, 3, &angle);
        const std::uint32_t now = 1000 * tick;
        const bool has_answer = dahl_node_receive(&c_node, &in, now, &c_out);
        if (node.receive(in, now, out) != has_answer || !same_frames(out, c_out)) {
            return false;
        }
        if (tick % 100 == 99) {
            node.bus_off(now);
            dahl_node_bus_off(&c_node, now);
        }
        if (node.tick(now, out) != dahl_node_tick(&c_node, now, &c_out) || !same_frames(out, c_out)) {
            return false;
        }
        answers += has_answer;
    }
    const dahl::Node &read_only = node;
    return read_only.c().counts.bus_off == 10 && answers > 50 && &node.c() == &read_only.c();
}

int main()
{
    const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}, other = {50.0f, 0.25f, 6.2831853f / 16384};
    dahl_plan_t c_plan, c_softer;
    dahl_state_t c_state = {};
    dahl_encoder_t c_encoder;
    if (dahl_prepare(&c_plan, &params) != DAHL_OK || dahl_prepare(&c_softer, &other) != DAHL_OK ||
        dahl_encoder_init(&c_encoder, 65536, -1, 300) != DAHL_OK || plan.prepare(100.0f, 0.5f, 6.2831853f / 16384) != DAHL_OK ||
        softer.prepare(50.0f, 0.25f, 6.2831853f / 16384) != DAHL_OK || encoder.init(65536, -1, 300) != DAHL_OK) {
        return 1;
    }
    if (plan.prepare(-1.0f, 0.5f) != DAHL_ERR_PARAM || encoder.init(1) != DAHL_ERR_RANGE) {
        return 2; // a refusal keeps both
    }
    dahl_encoder_home(&c_encoder, 65500);
    encoder.home(65500);
    std::uint32_t reading = 65500;
    for (int tick = 0; tick < 2000; tick++) {
        reading = (reading + random_word() % 800 + 65536 - 400) % 65536;
        const std::int32_t moved = encoder.move(reading);
        if (moved != dahl_encoder_move(&c_encoder, reading) ||
            !same(bearing.step_counts(moved), dahl_step_counts(tick < 1000 ? &c_plan : &c_softer, &c_state, moved))) {
            return 3;
        }
        if (tick == 999) {
            bearing.change_plan(softer);
            dahl_change_plan(&c_plan, &c_softer, &c_state);
        }
    }
    if (bearing.step_counts_q30(-7) != dahl_step_counts_q30(&c_softer, &c_state, -7) ||
        !same(bearing.step(1e-3f), dahl_step(&c_softer, &c_state, 1e-3f)) || bearing.state().w != c_state.w) {
        return 4;
    }
    bearing.set_torque(0.125f);
    dahl::Bearing still(zeros), flash(c_plan);
    if (!same(bearing.torque(), 0.125f) || !same(still.step_counts(100), 0.0f) || !bearing.state_ok() || !(flash.step_counts(3) > 0.1f) ||
        encoder.jumps() != c_encoder.jumps || encoder.jumps() < 100 || !defaults_are_those_of_the_header() ||
        dahl::counts_between(65535, 2, 65536) != 3 ||
        dahl::to_units(1 << 29, 500000) != 250000) {
        return 5;
    }
    if (!compensator_has_the_bits_of_c()) {
        return 6;
    }
    if (!node_has_the_frames_of_c()) {
        return 7;
    }
    std::printf("same bits\n");
    return 0;
}
