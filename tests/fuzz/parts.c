/* SPDX-License-Identifier: MIT */
/*
 * Ticks of every part on any plan, from rest: the laws of dahl_parts.h. What is exact is compared bit for bit (forms of one
 * model, mirrored motion, split travel, the sum of parts), the rest within its bound.
 */
#include "dahl_batch.h"
#include "plans.h"

enum { STEPS_MAX = 12 };

#define ONE ((int64_t)1 << 62)
#define LOAD_ONE (UINT32_C(1) << 30)

typedef struct {
    dahl_params_t params[2];
    float breakaway;
    int moves;
    int32_t dcounts[STEPS_MAX];
    uint32_t load[STEPS_MAX];
} walk_t;

static float ulp_of(float Fc)
{
    return nextafterf(Fc, INFINITY) - Fc;
}

static int32_t rounded_q30(int64_t w)
{
    return (int32_t)((w >> 32) + (w >> 31 & 1));
}

static void check_slip(const walk_t *walk)
{
    dahl_slip_params_t params = {2, walk->params[0].theta_per_count, {walk->params[0].sigma0, walk->params[1].sigma0},
                                 {walk->params[0].Fc, walk->params[1].Fc}};
    dahl_slip_plan_t plan;
    dahl_slip_state_t state = {{0}}, q30 = {{0}}, mirror = {{0}}, split = {{0}};
    if (dahl_slip_prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    float before = 0;
    for (int i = 0; i < walk->moves; i++) {
        int32_t n = walk->dcounts[i];
        float F = dahl_slip_step_counts(&plan, &state, n);
        (void)dahl_slip_step_counts_q30(&plan, &q30, n);
        (void)dahl_slip_step_counts_q30(&plan, &split, n / 3);
        (void)dahl_slip_step_counts_q30(&plan, &split, n - n / 3);
        LAW(memcmp(&state, &q30, sizeof state) == 0, "slip: Q30 and torque forms leave the same state");
        LAW(memcmp(&state, &split, sizeof state) == 0, "slip: travel may be split");
        LAW(n == INT32_MIN || dahl_slip_step_counts(&plan, &mirror, -n) == -F, "slip: odd");
        LAW(n >= 0 ? F >= before : F <= before, "slip: the torque never falls with travel");
        before = F;
        if (n == INT32_MIN) {
            mirror = state;
            mirror.x[0] = -state.x[0];
            mirror.x[1] = -state.x[1];
        }
    }
}

/* A loop back to where it came from leaves no trace, if nothing slips further than before. */
static void check_memory(const walk_t *walk)
{
    dahl_slip_params_t params = {1, walk->params[0].theta_per_count, {walk->params[0].sigma0}, {walk->params[0].Fc}};
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
    LAW(memcmp(&state, &kept, sizeof state) == 0, "slip: return-point memory");
}

/* From w to the exact solution, in parts of the larger Fc: each of 15 digits of a move may err by 2^-31. */
static void check_asymmetric_solution(const dahl_asymmetric_params_t *p, long double w, long double now, int32_t dcounts)
{
    long double larger = (long double)fmaxf(p->Fc_forward, p->Fc_backward);
    long double Fc = (long double)(dcounts < 0 ? p->Fc_backward : p->Fc_forward);
    long double end = (dcounts < 0 ? -Fc : Fc) / larger;
    long double u = fabsl((long double)dcounts) * (long double)p->theta_per_count * (long double)p->sigma0 / Fc;
    LAW(fabsl(now - (w - (end - w) * expm1l(-u))) <= 0x1p-27L, "asymmetric: a step is its equation solved");
}

static void check_asymmetric(const walk_t *walk)
{
    const dahl_params_t *p = &walk->params[0];
    const dahl_asymmetric_params_t params = {p->sigma0, p->Fc, walk->params[1].Fc, p->theta_per_count};
    float larger = fmaxf(params.Fc_forward, params.Fc_backward), before = 0;
    dahl_asymmetric_plan_t plan;
    dahl_state_t state = {0}, q30 = {0};
    if (dahl_asymmetric_prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    for (int i = 0; i < walk->moves; i++) {
        long double w = ldexpl((long double)state.w, -62);
        float F = dahl_asymmetric_step_counts(&plan, &state, walk->dcounts[i]);
        check_asymmetric_solution(&params, w, ldexpl((long double)state.w, -62), walk->dcounts[i]);
        int32_t ratio = dahl_asymmetric_step_counts_q30(&plan, &q30, walk->dcounts[i]);
        LAW(state.w == q30.w && ratio == rounded_q30(state.w), "asymmetric: Q30 and torque forms leave the same state");
        LAW(F <= params.Fc_forward + ulp_of(larger) && F >= -params.Fc_backward - ulp_of(larger), "asymmetric: between both Fc");
        LAW(walk->dcounts[i] >= 0 ? F >= before - ulp_of(larger) : F <= before + ulp_of(larger),
            "asymmetric: monotone");
        before = F;
    }
}

static void check_elastoplastic(const walk_t *walk)
{
    dahl_elastoplastic_plan_t plan;
    dahl_state_t state = {0}, q30 = {0}, mirror = {0};
    if (dahl_elastoplastic_prepare(&plan, &walk->params[0], walk->breakaway) != DAHL_OK) {
        return;
    }
    for (int i = 0; i < walk->moves; i++) {
        int32_t n = walk->dcounts[i];
        float F = dahl_elastoplastic_step_counts(&plan, &state, n);
        (void)dahl_elastoplastic_step_counts_q30(&plan, &q30, n);
        LAW(state.w == q30.w, "elasto-plastic: Q30 and torque forms leave the same state");
        LAW(fabsf(F) <= walk->params[0].Fc, "elasto-plastic: |F| <= Fc");
        LAW(llabs(state.w) < ONE + ((int64_t)1 << 31), "elasto-plastic: the state stays in range");
        if (n != INT32_MIN) {
            dahl_state_t before = {-mirror.w};
            (void)dahl_elastoplastic_step_counts_q30(&plan, &mirror, -n);
            (void)dahl_elastoplastic_step_counts_q30(&plan, &before, n);
            LAW(llabs(before.w + mirror.w) <= (int64_t)1 << 32, "elasto-plastic: odd, to a unit of Q30");
        }
    }
}

/* To and fro below the breakaway. */
static void check_no_creep(const walk_t *walk)
{
    dahl_elastoplastic_plan_t plan;
    dahl_state_t state = {0};
    if (dahl_elastoplastic_prepare(&plan, &walk->params[0], walk->breakaway) != DAHL_OK) {
        return;
    }
    int64_t most = plan.travel[1] == 0 || plan.counts_max == 0 ? 0 : plan.breakaway / (int64_t)plan.travel[1];
    int32_t n = most < 1 ? 0 : (int32_t)((uint32_t)walk->dcounts[0] % (uint32_t)(most < INT32_MAX ? most : INT32_MAX));
    (void)dahl_elastoplastic_step_counts_q30(&plan, &state, n);
    (void)dahl_elastoplastic_step_counts_q30(&plan, &state, -n);
    LAW(state.w == 0, "elasto-plastic: no creep below breakaway");
}

static void check_loaded(const walk_t *walk)
{
    dahl_plan_t plan;
    dahl_loaded_state_t state = {{0}, 0}, steady = {{0}, 0}, q30 = {{0}, 0};
    dahl_state_t alone = {0};
    if (dahl_prepare(&plan, &walk->params[0]) != DAHL_OK) {
        return;
    }
    for (int i = 0; i < walk->moves; i++) {
        double c = ldexp(walk->load[i] < LOAD_ONE * 2 - 1 ? walk->load[i] : LOAD_ONE * 2 - 1, -30);
        double last = ldexp((double)state.bristle.w, -62), energy = ldexp(state.load_q30, -30) * last * last;
        dahl_loaded_state_t taken = state;
        (void)dahl_loaded_step_counts_q30(&plan, &taken, 0, walk->load[i]);
        double w = ldexp((double)taken.bristle.w, -62);
        LAW(c * w * w <= energy * (1 + 0x1p-50), "load: stored energy never grows by a load");
        float F = dahl_loaded_step_counts(&plan, &state, walk->dcounts[i], walk->load[i]);
        (void)dahl_loaded_step_counts_q30(&plan, &q30, walk->dcounts[i], walk->load[i]);
        LAW(state.bristle.w == q30.bristle.w && state.load_q30 == q30.load_q30,
            "load: Q30 and torque forms leave the same state");
        LAW(fabs((double)F) <= c * (double)walk->params[0].Fc * (1 + 0x1p-23), "load: |F| <= c Fc");
        float one = dahl_loaded_step_counts(&plan, &steady, walk->dcounts[i], LOAD_ONE);
        float plain = dahl_step_counts(&plan, &alone, walk->dcounts[i]);
        LAW(memcmp(&one, &plain, sizeof one) == 0 || plain == 0 || fabsf(plain) < 0x1p-126f, "load: 1 is the element alone");
    }
}

/* The sum of a Dahl and a slip element, and the fast form beside it. */
static void check_parallel(const walk_t *walk)
{
    const dahl_params_t *p = &walk->params[0];
    dahl_params_t other = {walk->params[1].sigma0, walk->params[1].Fc, p->theta_per_count};
    dahl_slip_params_t slip_params = {1, p->theta_per_count, {other.sigma0}, {other.Fc}};
    dahl_plan_t plan;
    dahl_slip_plan_t slip;
    dahl_state_t state = {0}, alone = {0};
    dahl_slip_state_t slip_state = {{0}}, slip_alone = {{0}}, slip_q30 = {{0}};
    dahl_state_t q30 = {0};
    int32_t shares[2];
    if (dahl_prepare(&plan, p) != DAHL_OK || dahl_slip_prepare(&slip, &slip_params) != DAHL_OK) {
        return;
    }
    const dahl_part_t parts[] = {DAHL_PART(&plan, &state), DAHL_SLIP_PART(&slip, &slip_state)};
    const dahl_part_t in_q30[] = {DAHL_PART(&plan, &q30), DAHL_SLIP_PART(&slip, &slip_q30)};
    dahl_parallel_shares(shares, in_q30, 2);
    dahl_throughput_element_t fast[] = {
        {{(double)p->sigma0, (double)p->Fc, (double)p->theta_per_count}, 0, {0}, 0},
        {{(double)other.sigma0, (double)other.Fc, (double)other.theta_per_count}, 1, {0}, 0}};
    long double sum = (long double)p->Fc + (long double)other.Fc, ulp = ldexpl(1.0L, ilogbl(sum) - 23);
    float G[STEPS_MAX];
    LAW(dahl_throughput_parallel_counts(fast, 2, walk->dcounts, G, (size_t)walk->moves) == DAHL_OK, "fast: the same limits");
    for (int i = 0; i < walk->moves; i++) {
        float F = dahl_parallel_step_counts(parts, 2, walk->dcounts[i]);
        long double a = ldexpl((long double)dahl_part_move(&plan, &alone, walk->dcounts[i]), -62) * (long double)p->Fc;
        long double b = ldexpl((long double)dahl_slip_part_move(&slip, &slip_alone, walk->dcounts[i]), -62);
        LAW(fabsl((long double)F - (a + b * (long double)other.Fc)) <= 0.501L * ulp,
            "parallel: the sum of the parts, rounded once");
        long double ratio = ldexpl((long double)dahl_parallel_step_counts_q30(in_q30, shares, 2, walk->dcounts[i]), -30);
        LAW(fabsl(ratio * sum - (a + b * (long double)other.Fc)) <= 2.5L * ldexpl(sum, -30), "parallel: Q30 is the same sum");
        LAW(fabsl((long double)F - (long double)G[i]) <= 1.1L * ulp, "parallel: the fast form, within both bounds");
    }
}

static void check_work(const walk_t *walk)
{
    const dahl_params_t *p = &walk->params[0];
    dahl_plan_t plan;
    dahl_state_t state = {0}, alone = {0};
    dahl_work_t work = {{0}, {0}};
    if (dahl_prepare(&plan, p) != DAHL_OK) {
        return;
    }
    long double a = (long double)p->sigma0 / (long double)p->Fc, exact = 0, way = 0;
    for (int i = 0; i < walk->moves; i++) {
        long double x = fabsl((long double)walk->dcounts[i]) * (long double)p->theta_per_count;
        long double sw = ldexpl((long double)state.w, -62) * (walk->dcounts[i] < 0 ? -1 : 1);
        way += x;
        exact += (long double)p->Fc * (x + (1 - sw) * expm1l(-a * x) / a); /* the integral of F dtheta of this move */
        float F = dahl_work_step_counts(&plan, &state, &work, walk->dcounts[i]);
        LAW(F == dahl_step_counts(&plan, &alone, walk->dcounts[i]) && state.w == alone.w, "work: the torque is the element's");
    }
    long double got = (long double)dahl_work(p, &work), energy = (long double)p->Fc / a;
    long double bound = 0x1p-22L * fabsl(exact) + 0x1p-24L * energy + 0x1p-50L * way * (long double)p->Fc + 0x1p-120L;
    LAW(isinf(got) || fabsl(got - exact) <= bound,
        "work: the integral of the torque");
    LAW(!(dahl_work(p, &work) < -0x1p-28f * p->Fc / p->sigma0 * p->Fc), "work: from rest nothing is given");
}

static void check_way_back(const walk_t *walk, uint32_t part_of_Fc)
{
    const dahl_params_t *p = &walk->params[0];
    dahl_plan_t plan;
    dahl_state_t state = {0};
    int32_t found = 77;
    if (dahl_prepare(&plan, p) != DAHL_OK) {
        return;
    }
    (void)dahl_step_counts_q30(&plan, &state, walk->dcounts[0]);
    float F = p->Fc * (float)(int32_t)part_of_Fc * 0x1p-31f, here = dahl_torque(&plan, &state);
    dahl_err_t err = dahl_counts_to_torque(&plan, &state, F, &found);
    int s = F > here ? 1 : -1;
    dahl_state_t there = state, before = state;
    if (err != DAHL_OK) {
        float most = dahl_step_counts(&plan, &there, s * INT32_MAX);
        LAW(found == 77 && (s > 0 ? most < F : most > F), "way back: refused only where no move reaches it");
        return;
    }
    float reached = dahl_step_counts(&plan, &there, found);
    LAW(F == here ? found == 0 : s > 0 ? reached >= F : reached <= F, "way back: reaches the torque");
    LAW(F == here || (s > 0 ? dahl_step_counts(&plan, &before, found - 1) < F : dahl_step_counts(&plan, &before, found + 1) > F),
        "way back: no fewer counts do");
    LAW(dahl_tip_torque(&plan, part_of_Fc) <= p->Fc, "tips are below Fc");
}

/* Sizes of moves: a count or so, some digits, any. */
static int32_t any_counts(fuzz_bytes_t *bytes)
{
    uint8_t size = fuzz_u8(bytes) % 3u;
    uint32_t value = fuzz_u32(bytes);
    return size == 0 ? (int32_t)(value % 17u) - 8 : (int32_t)value >> (size == 1 ? 18 : 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    walk_t walk = {.params = {fuzz_params(&bytes), fuzz_params(&bytes)}};
    uint32_t torque = fuzz_u32(&bytes);
    walk.breakaway = fuzz_scaled(fuzz_u32(&bytes), -1 - (int)(torque % 3u));
    for (walk.moves = 0; walk.moves < STEPS_MAX && bytes.left > 0; walk.moves++) {
        walk.dcounts[walk.moves] = any_counts(&bytes);
        walk.load[walk.moves] = fuzz_u32(&bytes) >> (fuzz_u8(&bytes) % 4u);
    }
    check_slip(&walk);
    check_memory(&walk);
    check_asymmetric(&walk);
    check_elastoplastic(&walk);
    check_no_creep(&walk);
    check_loaded(&walk);
    check_parallel(&walk);
    check_work(&walk);
    check_way_back(&walk, torque);
    return 0;
}
