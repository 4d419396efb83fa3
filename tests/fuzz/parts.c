/* SPDX-License-Identifier: MIT */
/* Ticks of each element on any plan, from rest and from any bits: the contract of tests/lib/properties.h, and properties of one. */
#include "plans.h"
#include "../lib/properties.h"

enum { STEPS_MAX = 12 };

static long double fuzz_ratio(int64_t w)
{
    return ldexpl((long double)w, -62);
}

typedef struct {
    dahl_params_t params;
    float breakaway, ratio;
    int elements;
    int moves;
    move_t move[STEPS_MAX];
    int32_t dcounts[STEPS_MAX];
    int64_t bits; /* of a state */
} walk_t;

/* A state from 64 bits. Kind 0: each word is an end of its type. Kind 1: w is next to an end of its range. */
static any_state_t state_of(int64_t bits)
{
    const int kind = bits >> 4 & 3;
    const int64_t end = ((int64_t)1 << 62) + ((int64_t)1 << 31) - 1 + (bits >> 6 & 3);
    any_state_t state;
    uint32_t words[sizeof state / sizeof(uint32_t)];
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        const uint32_t any = (uint32_t)((uint64_t)bits >> i % 2 * 32) ^ 0x9E3779B9u * (uint32_t)(i / 2);
        words[i] = kind == 0 ? 0x80000000u - (any & 1u) : any;
    }
    memcpy(&state, words, sizeof state);
    state.dahl.w = kind != 1 ? state.dahl.w : bits < 0 ? -end : end;
    return state;
}

static void check_contract(const walk_t *walk)
{
    static subject_t subject;
    if (walk->params.theta_per_count == 0 || fuzz_judge(&walk->params) != DAHL_OK) {
        return;
    }
    for (size_t i = 0; i < MODELS; i++) {
        const model_t *model = &models[i];
        const set_t set = {walk->params, more_for(model, (float)walk->elements, walk->ratio, walk->breakaway)};
        if (subject_begin(&subject, model, &set)) {
            check_walk(&subject, walk->move, (size_t)walk->moves);
            check_any_bits(&subject, state_of(walk->bits), walk->move[0]);
            check_ends(&subject);
        }
    }
}

static void check_memory(const walk_t *walk)
{
    dahl_slip_params_t params = {1, walk->params.theta_per_count, {walk->params.sigma0}, {walk->params.Fc}};
    dahl_slip_plan_t plan;
    dahl_slip_state_t state = {{0}};
    if (dahl_slip_prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    int32_t out = walk->dcounts[0], back = out / 2;
    (void)dahl_slip_step_counts_q30(&plan, &state, out);
    dahl_slip_state_t kept = state;
    (void)dahl_slip_step_counts_q30(&plan, &state, -back);
    (void)dahl_slip_step_counts_q30(&plan, &state, back);
    HOLDS(memcmp(&state, &kept, sizeof state) == 0, "slip: return-point memory");
}

static void check_no_creep(const walk_t *walk)
{
    const model_t *model = model_with(MORE_IS_BREAKAWAY);
    const set_t set = {walk->params, walk->breakaway};
    any_plan_t plan;
    any_state_t state = {{0}};
    if (model->prepare(&plan, &set) != DAHL_OK) {
        return;
    }
    long double most = (long double)walk->breakaway / fuzz_travel(&walk->params, (long double)walk->params.theta_per_count);
    uint32_t below = most * 0.999L < 2147483647.0L ? (uint32_t)(most * 0.999L) : INT32_MAX;
    int32_t n = below < 1 ? 0 : (int32_t)((uint32_t)walk->dcounts[0] % below);
    (void)model->step_q30(&plan, &state, (move_t){n, 0});
    (void)model->step_q30(&plan, &state, (move_t){-n, 0});
    HOLDS(state.dahl.w == 0, "elasto-plastic: no creep below breakaway");
}

/* The bound of dahl_parts.h: relative to the result, and a part for each reversal. */
static long double work_bound(const dahl_params_t *p, long double work, int moves)
{
    const long double energy = (long double)p->Fc * (long double)p->Fc / (long double)p->sigma0;
    const long double u = fuzz_travel(p, (long double)p->theta_per_count), part = u < 4e-8L ? 1.5e-9L : 9.5e-10L;
    return 0.5L * ulp_of((float)fabsl(work)) * (1 + 0x1p-30L) + (moves + 0.5L) * part * energy + 0x1p-120L;
}

/* The integral of F dtheta = Fc (s - (s - w) exp(-a x)) over each move, from a state of any bits. */
static void check_work(const walk_t *walk)
{
    const dahl_params_t *p = &walk->params;
    dahl_plan_t plan;
    dahl_state_t state = {walk->bits}, alone = state, q30 = state;
    dahl_work_t work = {{0}, {0}}, work_q30 = {{0}, {0}};
    long double exact = 0;
    if (dahl_prepare(&plan, p) != DAHL_OK) {
        return;
    }
    const long double a = (long double)p->sigma0 / (long double)p->Fc;
    long double w = (long double)dahl_torque(&plan, &state) / p->Fc;
    w = dahl_state_ok(&state) ? fuzz_ratio(state.w) : w;
    for (int i = 0; i < walk->moves; i++) {
        const int32_t n = walk->dcounts[i];
        const long double x = fabsl((long double)n) * (long double)p->theta_per_count, sw = w * (n < 0 ? -1 : 1);
        exact += (long double)p->Fc * (x + (1 - sw) * expm1l(-a * x) / a);
        const float F = dahl_work_step_counts(&plan, &state, &work, n);
        (void)dahl_work_step_counts_q30(&plan, &q30, &work_q30, n);
        HOLDS(F == dahl_step_counts(&plan, &alone, n) && state.w == alone.w, "work: the torque is the element's");
        w = fuzz_ratio(state.w);
    }
    HOLDS(q30.w == state.w && memcmp(&work, &work_q30, sizeof work) == 0, "work: both forms leave the same state and sums");
    const long double got = (long double)dahl_work(p, &work);
    HOLDS(isinf(got) || fabsl(got - exact) <= work_bound(p, exact, walk->moves), "work: the integral of the torque");
}

/* Any torque up to Fc, an end or its neighbour, beyond Fc, nearly none, or no number. Near Fc a count changes the torque by a rounding or
 * not at all. */
static float any_torque(float Fc, uint32_t part)
{
    const float any = Fc * (float)(int32_t)part * 0x1p-31f, near = nextafterf(Fc, 0.0f);
    const float torques[] = {Fc, -Fc, near, 1.01f * Fc, 0.0f, 1e-12f * Fc, NAN, -HUGE_VALF};
    return (part & 8u) != 0 ? any : torques[part & 7u];
}

static void check_inverse(const walk_t *walk, uint32_t part_of_Fc)
{
    const dahl_params_t *p = &walk->params;
    dahl_plan_t plan;
    dahl_state_t state = {walk->bits};
    int32_t found = 77;
    if (dahl_prepare(&plan, p) != DAHL_OK) {
        return;
    }
    if (walk->moves > 1) {
        (void)dahl_step_counts_q30(&plan, &state, walk->dcounts[0]);
    }
    float F = any_torque(p->Fc, part_of_Fc), here = dahl_torque(&plan, &state);
    dahl_err_t err = dahl_counts_to_torque(&plan, &state, F, &found);
    int s = F > here ? 1 : -1;
    dahl_state_t there = state, before = state;
    HOLDS((err == DAHL_ERR_PARAM) == !isfinite(F), "inverse: DAHL_ERR_PARAM if and only if F is not finite");
    HOLDS(found == 77 || isfinite(F), "inverse: a refusal writes nothing");
    if (!isfinite(F)) {
        return;
    }
    if (err != DAHL_OK) {
        float most = dahl_step_counts(&plan, &there, s * INT32_MAX);
        HOLDS(found == 77 && (s > 0 ? most < F : most > F), "inverse: refused only if no move reaches the torque");
        return;
    }
    float reached = dahl_step_counts(&plan, &there, found);
    HOLDS(F == here ? found == 0 : s > 0 ? reached >= F : reached <= F, "inverse: the move reaches the torque");
    HOLDS(F == here || (s > 0 ? dahl_step_counts(&plan, &before, found - 1) < F : dahl_step_counts(&plan, &before, found + 1) > F),
          "inverse: one count less does not");
}

/* The ends of a loop of a stroke that is repeated to and fro. */
static void check_tip(const dahl_params_t *p, uint32_t stroke)
{
    dahl_plan_t plan;
    if (p->theta_per_count == 0 || dahl_prepare(&plan, p) != DAHL_OK) {
        return;
    }
    const long double u = fuzz_travel(p, (long double)p->theta_per_count), exact = (long double)p->Fc * tanhl(u * stroke / 2);
    const float tip = dahl_tip_torque(&plan, stroke);
    HOLDS(fabsl((long double)tip - exact) <= 0x1p-30L * exact + 0.51L * ulp_of((float)exact), "the tip of a loop is tanh");
    HOLDS(tip <= p->Fc && dahl_tip_torque(&plan, 0) == 0, "tips are between 0 and Fc");
}

/* The bits of the plain element. Half the load gives exactly half the torque; one below 2^-95 may be 0 under the smaller Fc. */
static void check_load_of_1(const walk_t *walk)
{
    dahl_plan_t plan;
    dahl_loaded_state_t loaded = {{0}, 0}, half = {{0}, 0};
    dahl_state_t plain = {0}, clamped = {0}, by_angle = {0};
    if (dahl_prepare(&plan, &walk->params) != DAHL_OK) {
        return;
    }
    for (int i = 0; i < walk->moves; i++) {
        const int32_t n = walk->dcounts[i];
        const float dtheta = fuzz_float_of(walk->move[i].load_q30 ^ (uint32_t)n), F = dahl_step_counts(&plan, &plain, n);
        HOLDS(dahl_loaded_step_counts(&plan, &loaded, n, ONE_Q30) == F, "a load of 1 is the plain element by counts");
        HOLDS(dahl_loaded_step_counts(&plan, &half, n, ONE_Q30 / 2) == F / 2 || fabsf(F) < 0x1p-95f,
              "half the load, half the torque");
        HOLDS(dahl_clamped_step(&plan, &clamped, dtheta, ONE_Q30) == dahl_step(&plan, &by_angle, dtheta),
              "a load of 1 is the plain element by angle");
        HOLDS(clamped.w == by_angle.w, "a load of 1 leaves the state of the plain element");
    }
}

static int32_t any_counts(fuzz_bytes_t *bytes)
{
    uint8_t size = fuzz_u8(bytes) % 3u;
    uint32_t value = fuzz_u32(bytes);
    return size == 0 ? (int32_t)(value % 17u) - 8 : (int32_t)value >> (size == 1 ? 18 : 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    walk_t walk = {.params = fuzz_params(&bytes)};
    uint32_t torque = fuzz_u32(&bytes);
    walk.breakaway = fuzz_scaled(fuzz_u32(&bytes), torque % 8u == 7 ? -32 : -1 - (int)(torque % 3u));
    walk.ratio = fuzz_scaled(torque, (int)(torque >> 24) % 9 - 5);
    walk.elements = (int)(torque >> 16 & 7u) + 1;
    walk.bits = (int64_t)fuzz_u64(&bytes) >> fuzz_u8(&bytes) % 4u * (torque & 2u);
    for (walk.moves = 0; walk.moves < STEPS_MAX && bytes.left > 0; walk.moves++) {
        walk.dcounts[walk.moves] = any_counts(&bytes);
        const move_t move = {walk.dcounts[walk.moves], fuzz_u32(&bytes) >> (fuzz_u8(&bytes) % 4u)};
        walk.move[walk.moves] = move;
    }
    check_contract(&walk);
    check_memory(&walk);
    check_no_creep(&walk);
    check_work(&walk);
    check_inverse(&walk, torque);
    check_tip(&walk.params, (uint32_t)walk.bits >> torque % 32u);
    check_load_of_1(&walk);
    return 0;
}
