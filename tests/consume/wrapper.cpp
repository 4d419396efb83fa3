// SPDX-License-Identifier: MIT
// dahl.hpp against the C calls: the same bits, known sizes, and static objects without constructors at start.
#include <dahl.hpp>

#include <cstdint>
#include <cstdio>
#include <type_traits>

static_assert(dahl::state_size == 8, "the state of one bearing");
static_assert(dahl::plan_size == sizeof(dahl::Plan) && dahl::encoder_size == sizeof(dahl::Encoder), "the wrapper adds no member");
static_assert(sizeof(dahl::Bearing) == dahl::state_size + 8 || sizeof(void *) != 8, "a state and a pointer");
static_assert(std::is_trivially_destructible<dahl::Bearing>::value && std::is_trivially_copyable<dahl::Bearing>::value, "");
static_assert(std::is_standard_layout<dahl::Plan>::value && std::is_trivially_copyable<dahl::Encoder>::value, "");

static dahl::Plan plan, softer;
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
    std::printf("same bits\n");
    return 0;
}
