/* SPDX-License-Identifier: MIT */
/* Ticks by counts and by angle on any plan and any state, with new torques and plans between them. The properties are those of dahl.h
 * and lib/model/bristle_update.h; the exact solution is expm1l. */
#include "plans.h"

#define ONE ((int64_t)1 << 62)
#define PAST ((int64_t)1 << 31) /* a step exceeds 1 by less */

enum { COUNTS, ANGLE, SET, CHANGE, PLACE, BETWEEN, UNITS, TRAVELS, KINDS };
enum { STEPS_MAX = 12 };

typedef struct {
    const fuzz_plan_t *plan, *other;
    dahl_state_t state;
} walk_t;

static uint32_t bits_of(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static int is_in_range(int64_t w)
{
    return w < ONE + PAST && w >= -ONE - PAST;
}

static int32_t rounded_q30(int64_t w)
{
    return (int32_t)((w >> 32) + (w >> 31 & 1));
}

static long double value_of(int64_t w)
{
    return (long double)w * 0x1p-62L;
}

static void check_torque(const walk_t *walk, int64_t w, float F)
{
    float Fc = walk->plan->params.Fc;
    long double exact = value_of(w) * (long double)Fc;
    HOLDS(F <= Fc && F >= -Fc, "|F| <= Fc");
    HOLDS(bits_of(F) == bits_of(dahl_torque(&walk->plan->plan, &(dahl_state_t){w})), "a step returns the torque of its state");
    if (w >= ONE || w <= -ONE) {
        HOLDS(F == (w > 0 ? Fc : -Fc), "saturation is exact");
        return;
    }
    long double ulp = w == 0 ? 0 : ldexpl(1.0L, ilogbl(exact) - 23);
    HOLDS(fabsl((long double)F - exact) <= 0.5121L * ulp, "torque within 0.512 ulp of itself");
}

/* The gap is rounded to Q30, and g has a relative error. */
static void check_solution(int64_t w, int64_t now, long double u, int forward, long double g_error)
{
    long double g = -expm1l(-u), target = forward ? 1.0L : -1.0L;
    long double exact = value_of(w) + (target - value_of(w)) * g;
    HOLDS(fabsl(value_of(now) - exact) <= g * (0x1p-31L + 2.0L * g_error) + 0x1p-56L, "a step is Eq. 1 solved");
}

static void check_direction(int64_t w, int64_t now, int forward)
{
    HOLDS(is_in_range(now), "the state stays in range");
    HOLDS(forward ? now >= w : now <= w, "the state moves towards its target");
}

static void move_counts(walk_t *walk, int32_t dcounts, int exact)
{
    const dahl_plan_t *plan = &walk->plan->plan;
    int64_t w = walk->state.w;
    dahl_state_t q30_state = walk->state, mirror = {~w};
    float F = dahl_step_counts(plan, &walk->state, dcounts);
    int32_t q30 = dahl_step_counts_q30(plan, &q30_state, dcounts);
    HOLDS(q30_state.w == walk->state.w, "Q30 and torque forms leave the same state");
    HOLDS(q30 == rounded_q30(walk->state.w) && q30 <= 1 << 30 && q30 >= -(1 << 30), "Q30 is the state, rounded; |F| <= Fc");
    check_direction(w, walk->state.w, dcounts >= 0);
    check_torque(walk, walk->state.w, F);
    if (dcounts != INT32_MIN) {
        dahl_step_counts_q30(plan, &mirror, -dcounts);
        HOLDS(mirror.w == ~walk->state.w, "backward is forward on the complement");
    }
    if (exact) {
        long double travel = (long double)dcounts * (long double)walk->plan->params.theta_per_count;
        check_solution(w, walk->state.w, fuzz_travel(&walk->plan->params, travel), dcounts > 0, 0x1p-32L);
    }
}

static int32_t any_counts(fuzz_bytes_t *bytes, uint32_t size)
{
    uint32_t value = fuzz_u32(bytes);
    return size == 0 ? (int32_t)(value % 17u) - 8 : (int32_t)value >> (size == 1 ? 18 : 0);
}

/* Any float, often infinite, or one whose travel is 2^-72 to 2^7 presliding lengths. */
static float any_angle(const walk_t *walk, fuzz_bytes_t *bytes, uint32_t size)
{
    uint32_t value = fuzz_u32(bytes);
    const dahl_params_t *params = &walk->plan->params;
    int exponent = (int)((value >> 23 & 255u) % 80u) - 72 - ilogbf(params->sigma0) + ilogbf(params->Fc);
    float scaled = fuzz_scaled(value, exponent);
    const float any = (value & 7u) == 0 ? HUGE_VALF : fuzz_float_of(value), angle = size == 0 ? any : scaled;
    return value >> 31 ? -angle : angle;
}

/* A subnormal angle or torque counts as 0. */
static int is_zero(float x)
{
    return fabsf(x) < 0x1p-126f;
}

static void check_angle(const walk_t *walk, int64_t w, float dtheta)
{
    long double u = fuzz_travel(&walk->plan->params, (long double)dtheta);
    if (u >= 0x1p-63L && !is_zero(dtheta)) {
        check_solution(w, walk->state.w, u, dtheta > 0, 0x1p-29L);
    }
}

static void move_angle(walk_t *walk, float dtheta, int exact)
{
    const dahl_plan_t *plan = &walk->plan->plan;
    int64_t w = walk->state.w;
    dahl_state_t mirror = {~w};
    float F = dahl_step(plan, &walk->state, dtheta);
    check_torque(walk, walk->state.w, F);
    if (isnan(dtheta) || is_zero(dtheta)) {
        HOLDS(walk->state.w == w, "a subnormal angle, 0 and NaN keep the state");
    } else if (isinf(dtheta)) {
        HOLDS(walk->state.w == (dtheta > 0 ? ONE : -ONE), "infinity saturates");
    } else {
        check_direction(w, walk->state.w, dtheta > 0);
        dahl_step(plan, &mirror, -dtheta);
        HOLDS(mirror.w == ~walk->state.w, "backward is forward on the complement");
    }
    if (exact && isfinite(dtheta)) {
        check_angle(walk, w, dtheta);
    }
}

static void set(walk_t *walk, float F)
{
    const float Fc = walk->plan->params.Fc;
    const int64_t w = walk->state.w;
    dahl_set_torque(&walk->plan->plan, &walk->state, F);
    HOLDS(!isnan(F) || walk->state.w == w, "NaN keeps the state");
    if (!isnan(F)) {
        float wanted = fminf(fmaxf(F, -Fc), Fc);
        float got = dahl_torque(&walk->plan->plan, &walk->state);
        HOLDS(walk->state.w <= ONE && walk->state.w >= -ONE, "a set torque is clamped");
        const long double ratio = is_zero(F) ? 0 : (long double)wanted / (long double)Fc;
        HOLDS(fabsl(value_of(walk->state.w) - ratio) <= 0x1.00001p-63L, "a set torque is rounded to the nearest state");
        HOLDS(fabsf(wanted) < 0x1p-36f * Fc || got == wanted, "a set torque is read back");
    }
}

/* The torque is clamped to the new Fc, and scaled if the bristle becomes softer. */
static void change(walk_t *walk)
{
    const dahl_params_t *from = &walk->plan->params, *to = &walk->other->params;
    const fuzz_plan_t *left = walk->plan;
    long double softer = (long double)to->sigma0 / (long double)from->sigma0;
    long double F = fmaxl(fminl(value_of(walk->state.w), 1.0L), -1.0L) * (long double)from->Fc; /* as dahl_torque returns it */
    dahl_change_plan(&walk->plan->plan, &walk->other->plan, &walk->state);
    long double now = value_of(walk->state.w) * (long double)to->Fc, most = (long double)to->Fc;
    long double wanted = fmaxl(fminl(F * fminl(softer, 1.0L), most), -most);
    HOLDS(walk->state.w <= ONE && walk->state.w >= -ONE, "|F| is within the new Fc");
    HOLDS(fabsl(now - wanted) <= 0x1p-30L * fabsl(wanted) + 0x1p-61L * ((long double)from->Fc + most), "F is kept, or scaled with sigma0");
    HOLDS(now * now / (long double)to->sigma0 <= F * F / (long double)from->sigma0, "the stored energy does not grow");
    walk->plan = walk->other;
    walk->other = left;
}

/* A state in range, a small one, or any bits, which the next call clamps. */
static void place(walk_t *walk, uint64_t value, uint32_t size)
{
    int64_t w = (int64_t)(value % (uint64_t)(ONE + PAST));
    w = size == 0 ? w : w >> (value >> 58);
    walk->state.w = size == 2 ? (int64_t)value : value >> 63 ? -w : w;
    HOLDS(dahl_state_ok(&walk->state) == is_in_range(walk->state.w), "dahl_state_ok() is the range to the bit");
    w = is_in_range(walk->state.w) ? walk->state.w : walk->state.w < 0 ? -ONE : ONE;
    check_torque(walk, w, dahl_torque(&walk->plan->plan, &walk->state));
    dahl_step_counts(&walk->plan->plan, &walk->state, 0);
    HOLDS(walk->state.w == w, "any bits are a safe state");
}

static void between(fuzz_bytes_t *bytes)
{
    uint32_t before = fuzz_u32(bytes), now = fuzz_u32(bytes), n = fuzz_u32(bytes);
    int64_t turn = n == 0 ? (int64_t)1 << 32 : n;
    int64_t way = dahl_counts_between(before, now, n);
    HOLDS(2 * way >= -turn && 2 * way < turn, "the move is the shortest one; half a turn is negative");
    HOLDS((before % turn + way - now % turn) % turn == 0, "the move leads to the reading");
}

/* An Fc above 2^30 units counts as 2^30. */
static void units(fuzz_bytes_t *bytes)
{
    const int32_t ratio = (int32_t)fuzz_u32(bytes) >> fuzz_u8(bytes) % 32u;
    const uint32_t Fc_units = fuzz_u32(bytes) >> fuzz_u8(bytes) % 32u;
    const int64_t one = (int64_t)1 << 30, Fc = Fc_units < one ? (int64_t)Fc_units : one;
    const int64_t off = ratio * Fc - one * dahl_to_units(ratio, Fc_units);
    HOLDS(-one / 2 <= off && off < one / 2, "units: the nearest whole number, a half rounded up");
}

static void travels(const walk_t *walk, float one, float two)
{
    dahl_state_t x = walk->state, y = walk->state;
    if (isfinite(one) && isfinite(two)) {
        dahl_step(&walk->plan->plan, &x, fminf(one, two));
        dahl_step(&walk->plan->plan, &y, fmaxf(one, two));
        HOLDS(x.w <= y.w, "monotone in travel");
    }
}

/* Any float, or Fc/4 to Fc/2. */
static float any_torque(const walk_t *walk, fuzz_bytes_t *bytes, uint32_t size)
{
    uint32_t value = fuzz_u32(bytes);
    return size == 0 ? fuzz_float_of(value) : walk->plan->params.Fc * fuzz_scaled(value, -2);
}

static void act(walk_t *walk, fuzz_bytes_t *bytes)
{
    uint8_t what = fuzz_u8(bytes);
    uint32_t size = (what >> 4) % 3u;
    float one;
    switch (what % KINDS) {
    case COUNTS: move_counts(walk, any_counts(bytes, size), what >> 7); break;
    case ANGLE: move_angle(walk, any_angle(walk, bytes, size), what >> 7); break;
    case SET: set(walk, any_torque(walk, bytes, size)); break;
    case CHANGE: change(walk); break;
    case PLACE: place(walk, fuzz_u64(bytes), size); break;
    case BETWEEN: between(bytes); break;
    case UNITS: units(bytes); break;
    default:
        one = any_angle(walk, bytes, 1);
        travels(walk, one, size == 0 ? nextafterf(one, INFINITY) : any_angle(walk, bytes, size));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static fuzz_plan_t first, second;
    fuzz_bytes_t bytes = {data, size};
    walk_t walk = {.plan = fuzz_plan(&bytes, &first), .other = fuzz_plan(&bytes, &second)};
    if (!first.good || !second.good) {
        return 0;
    }
    for (int i = 0; i < STEPS_MAX && bytes.left > 0; i++) {
        act(&walk, &bytes);
    }
    return 0;
}
