// SPDX-License-Identifier: MIT
/*
 * The calls of dahl.h and dahl_encoder.h as members, for C++11 and later: header only, nothing to link beside the C library.
 * No constructor runs at start, no destructor, no exception, no heap, no virtual call: a static bearing lies in .bss or in .data
 * as its C struct does, and each call compiles to the C call. dahl.h documents each call, its bounds and costs, and why any
 * bits are a safe state.
 *
 * USE
 *   static dahl::Plan plan;                        // or a const dahl_plan_t in flash, as `dahl plan` writes it
 *   static dahl::Bearing bearing(plan);            // relaxed
 *   static dahl::Encoder encoder;
 *   if (plan.prepare(100.0f, 0.5f, 6.2831853f / 16384) != DAHL_OK || encoder.init(65536) != DAHL_OK) stop();
 *   each tick:  F = bearing.step_counts(encoder.move(reading));
 */
#ifndef DAHL_HPP
#define DAHL_HPP

// Not <cstddef> and <cstdint>: avr-gcc has no C++ library.
#include <stddef.h>
#include <stdint.h>

#include "dahl.h"
#include "dahl_encoder.h"

namespace dahl {

// Bytes, for a static_assert of one's own.
constexpr size_t plan_size = sizeof(dahl_plan_t);
constexpr size_t state_size = sizeof(dahl_state_t);
constexpr size_t encoder_size = sizeof(dahl_encoder_t);

// Parameters, prepared once; shared by any number of bearings. Of all zeros until prepare(): every torque is then 0 N m.
class Plan {
public:
    constexpr Plan() : plan_() {}

    // sigma0 in N m/rad, Fc in N m, theta_per_count in rad; 0: no encoder, step() only. DAHL_OK, or why the plan is unchanged.
    DAHL_NODISCARD dahl_err_t prepare(float sigma0, float Fc, float theta_per_count = 0.0f)
    {
        const dahl_params_t params = {sigma0, Fc, theta_per_count};
        return dahl_prepare(&plan_, &params);
    }

    constexpr const dahl_plan_t &c() const { return plan_; }

private:
    dahl_plan_t plan_;
};

// One bearing: a plan, which must outlive it, and a state, relaxed at first. One call at a time. Torques in N m.
class Bearing {
public:
    explicit constexpr Bearing(const Plan &plan) : plan_(&plan.c()), state_() {}
    explicit constexpr Bearing(const dahl_plan_t &plan) : plan_(&plan), state_() {}

    float step_counts(int32_t dcounts) { return dahl_step_counts(plan_, &state_, dcounts); }
    int32_t step_counts_q30(int32_t dcounts) { return dahl_step_counts_q30(plan_, &state_, dcounts); }
    float step(float dtheta) { return dahl_step(plan_, &state_, dtheta); }

    float torque() const { return dahl_torque(plan_, &state_); }
    void set_torque(float F) { dahl_set_torque(plan_, &state_, F); }

    // Go on with other parameters, between two ticks: dahl_change_plan().
    void change_plan(const Plan &to) { change_plan(to.c()); }
    void change_plan(const dahl_plan_t &to)
    {
        dahl_change_plan(plan_, &to, &state_);
        plan_ = &to;
    }

    constexpr const dahl_state_t &state() const { return state_; }
    bool state_ok() const { return dahl_state_ok(&state_) != 0; }

private:
    const dahl_plan_t *plan_;
    dahl_state_t state_;
};

// From the readings of a counter to the counts of each tick: dahl_encoder.h. Gives no motion until init().
class Encoder {
public:
    constexpr Encoder() : encoder_() {}

    DAHL_NODISCARD dahl_err_t init(uint32_t modulus, int sign = 1, uint32_t largest_step = 0)
    {
        return dahl_encoder_init(&encoder_, modulus, sign, largest_step);
    }

    int32_t move(uint32_t reading) { return dahl_encoder_move(&encoder_, reading); }
    void home(uint32_t reading) { dahl_encoder_home(&encoder_, reading); }
    constexpr uint32_t jumps() const { return encoder_.jumps; }

private:
    dahl_encoder_t encoder_;
};

// A torque in whole units of your own from F/Fc in Q30, and Fc in those units: dahl_to_units().
inline int32_t to_units(int32_t ratio_q30, uint32_t Fc_units)
{
    return dahl_to_units(ratio_q30, Fc_units);
}

// Shortest signed way from one reading to the next; modulus is where the reading wraps, 0 for all 32 bits.
inline int32_t counts_between(uint32_t before, uint32_t now, uint32_t modulus = 0)
{
    return dahl_counts_between(before, now, modulus);
}

} // namespace dahl

#endif
