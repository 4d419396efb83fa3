// SPDX-License-Identifier: MIT
/**
 * @file dahl.hpp
 * @brief C++11 classes for dahl.h, dahl_encoder.h, dahl_compensator.h and dahl_node.h.
 *
 * Use this header to call the C library from C++. It is header only; link the C library. No
 * constructor runs at start-up. There is no destructor, exception, heap or virtual call. A static
 * element lies in .bss or .data as its C structure does, and each call compiles to the C call.
 * dahl.h documents the calls, their error bounds and costs, and why any bits are a safe
 * state, but not a safe plan.
 *
 * @par Use
 * @code{.cpp}
 *   static dahl::Plan plan;              // or a const dahl_plan_t in flash, from `dahl plan`
 *   static dahl::Bearing bearing(plan);  // relaxed
 *   static dahl::Encoder encoder;
 *   if (plan.prepare(100.0f, 0.5f, 6.2831853f / 16384) != DAHL_OK) stop();
 *   if (encoder.init(65536) != DAHL_OK) stop();
 *   F = bearing.step_counts(encoder.move(reading));   // each tick
 * @endcode
 *
 * dahl::Node needs the component node: include dahl_node.h before this header.
 */
#ifndef DAHL_HPP
#define DAHL_HPP

// avr-gcc has no C++ library, so <cstddef> and <cstdint> are not available.
#include <stddef.h>
#include <stdint.h>

#include "dahl.h"
#include "dahl_compensator.h"
#include "dahl_encoder.h"

/// The C library as classes.
namespace dahl {

constexpr size_t plan_size = sizeof(dahl_plan_t);       ///< [byte]
constexpr size_t state_size = sizeof(dahl_state_t);     ///< [byte]
constexpr size_t encoder_size = sizeof(dahl_encoder_t); ///< [byte]

/// Prepared parameters, shared by any number of elements. Before prepare(), torques are 0 N m.
class Plan {
public:
    /// A plan of all zeros.
    constexpr Plan() : plan_() {}

    /**
     * Call dahl_prepare().
     * @param sigma0          [N m/rad] stiffness at rest
     * @param Fc              [N m] Coulomb torque
     * @param theta_per_count [rad/count] 0: no encoder, step() only
     * @return #DAHL_OK; otherwise the plan is unchanged
     */
    DAHL_NODISCARD dahl_err_t prepare(float sigma0, float Fc, float theta_per_count = 0.0f)
    {
        const dahl_params_t params = {sigma0, Fc, theta_per_count};
        return dahl_prepare(&plan_, &params);
    }

    /// The C plan.
    constexpr const dahl_plan_t &c() const { return plan_; }

private:
    dahl_plan_t plan_;
};

/// One Dahl element: a reference to a plan, which must outlive it, and a state. One call at a time.
class Bearing {
public:
    /// A relaxed element.
    explicit constexpr Bearing(const Plan &plan) : plan_(&plan.c()), state_() {}
    /// A relaxed element on a C plan.
    explicit constexpr Bearing(const dahl_plan_t &plan) : plan_(&plan), state_() {}

    /// dahl_step_counts()
    float step_counts(int32_t dcounts) { return dahl_step_counts(plan_, &state_, dcounts); }
    /// dahl_step_counts_q30()
    int32_t step_counts_q30(int32_t dcounts)
    {
        return dahl_step_counts_q30(plan_, &state_, dcounts);
    }
    /// dahl_step()
    float step(float dtheta) { return dahl_step(plan_, &state_, dtheta); }

    /// dahl_torque()
    float torque() const { return dahl_torque(plan_, &state_); }
    /// dahl_set_torque()
    void set_torque(float F) { dahl_set_torque(plan_, &state_, F); }

    /// dahl_change_plan(): use other parameters from now on. Call it between two ticks.
    void change_plan(const Plan &to) { change_plan(to.c()); }
    /// dahl_change_plan() to a C plan.
    void change_plan(const dahl_plan_t &to)
    {
        dahl_change_plan(plan_, &to, &state_);
        plan_ = &to;
    }

    /// The C state.
    constexpr const dahl_state_t &state() const { return state_; }
    /// dahl_state_ok()
    bool state_ok() const { return dahl_state_ok(&state_) != 0; }

private:
    const dahl_plan_t *plan_;
    dahl_state_t state_;
};

/// Readings of a counter to counts per tick (dahl_encoder.h). It never moves before init(). Do not
/// pass a reading that is known to be bad: the next move then covers both ticks.
class Encoder {
public:
    /// An encoder that is not initialized.
    constexpr Encoder() : encoder_() {}

    /// dahl_encoder_init()
    DAHL_NODISCARD dahl_err_t init(uint32_t modulus, int sign = 1, uint32_t largest_step = 0)
    {
        return dahl_encoder_init(&encoder_, modulus, sign, largest_step);
    }

    /// dahl_encoder_move(): 0 for a first reading, a jump, and the reading after a jump.
    int32_t move(uint32_t reading) { return dahl_encoder_move(&encoder_, reading); }
    /// dahl_encoder_home(). Mask the interrupt of the tick while you set the counter and call it.
    void home(uint32_t reading) { dahl_encoder_home(&encoder_, reading); }
    /// Number of rejected jumps.
    constexpr uint32_t jumps() const { return encoder_.jumps; }

private:
    dahl_encoder_t encoder_;
};

/// Prepared parameters of compensators. Before prepare(), torques are 0.
class CompensatorPlan {
public:
    /// A plan of all zeros.
    constexpr CompensatorPlan() : plan_() {}

    /// dahl_compensator_prepare(). If it fails, the plan is unchanged.
    DAHL_NODISCARD dahl_compensator_err_t prepare(const dahl_compensator_params_t &params)
    {
        return dahl_compensator_prepare(&plan_, &params);
    }

    /// The C plan.
    constexpr const dahl_compensator_plan_t &c() const { return plan_; }

private:
    dahl_compensator_plan_t plan_;
};

/**
 * Compensator of one axis (dahl_compensator.h): a reference to a plan, which must outlive it, and a
 * state. Call move() before the tick of the element, and torque() after it:
 * @code{.cpp}
 *   move = compensator.move(is_good ? encoder.move(reading) : 0, is_good);
 *   command += compensator.torque(bearing.step_counts_q30(move));   // in Q30 of Fc
 * @endcode
 */
class Compensator {
public:
    /// A relaxed compensator, faded out.
    explicit constexpr Compensator(const CompensatorPlan &plan) : plan_(&plan.c()), state_() {}
    /// The same on a C plan.
    explicit constexpr Compensator(const dahl_compensator_plan_t &plan) : plan_(&plan), state_() {}

    /// dahl_compensator_move()
    int32_t move(int32_t dcounts, bool is_good)
    {
        return dahl_compensator_move(plan_, &state_, dcounts, is_good);
    }
    /// dahl_compensator_torque()
    int32_t torque(int32_t ratio_q30) { return dahl_compensator_torque(plan_, &state_, ratio_q30); }

    /// dahl_compensator_change(): use other parameters from now on. Call it between two ticks.
    void change(const CompensatorPlan &to) { change(to.c()); }
    /// dahl_compensator_change() to a C plan.
    void change(const dahl_compensator_plan_t &to)
    {
        dahl_compensator_change(plan_, &to, &state_);
        plan_ = &to;
    }

    /// The C state, with all telemetry.
    constexpr const dahl_compensator_t &state() const { return state_; }

private:
    const dahl_compensator_plan_t *plan_;
    dahl_compensator_t state_;
};

/// Prepared parameters of residual observers. Before prepare(), torques are 0.
class ResidualPlan {
public:
    /// A plan of all zeros.
    constexpr ResidualPlan() : plan_() {}

    /// dahl_residual_prepare(). If it fails, the plan is unchanged.
    DAHL_NODISCARD dahl_compensator_err_t prepare(const dahl_compensator_params_t &params,
                                                  const dahl_residual_params_t &residual)
    {
        return dahl_residual_prepare(&plan_, &params, &residual);
    }

    /// The C plan.
    constexpr const dahl_residual_plan_t &c() const { return plan_; }

private:
    dahl_residual_plan_t plan_;
};

/**
 * Residual observer of one axis (dahl_compensator.h): a reference to a plan, which must outlive it,
 * and a state. Call torque() after Compensator::move(), and note() at the end of the tick.
 */
class Residual {
public:
    /// An observer without a residual.
    explicit constexpr Residual(const ResidualPlan &plan) : plan_(&plan.c()), state_() {}
    /// The same on a C plan.
    explicit constexpr Residual(const dahl_residual_plan_t &plan) : plan_(&plan), state_() {}

    /// dahl_residual_torque()
    int32_t torque(const Compensator &compensator, int32_t dcounts)
    {
        return dahl_residual_torque(plan_, &state_, &compensator.state(), dcounts);
    }
    /// dahl_residual_note() with dahl_residual_q24(): motor torque less known feed-forwards, N m.
    void note(float unexplained) { note_q24(dahl_residual_q24(plan_, unexplained)); }
    /// dahl_residual_note()
    void note_q24(int32_t unexplained_q24) { dahl_residual_note(&state_, unexplained_q24); }

    /// dahl_residual_change(): use other parameters from now on. Call it between two ticks.
    void change(const ResidualPlan &to) { change(to.c()); }
    /// dahl_residual_change() to a C plan.
    void change(const dahl_residual_plan_t &to)
    {
        dahl_residual_change(plan_, &to, &state_);
        plan_ = &to;
    }

    /// The C state, with all telemetry.
    constexpr const dahl_residual_t &state() const { return state_; }

private:
    const dahl_residual_plan_t *plan_;
    dahl_residual_t state_;
};

/// dahl_to_units()
inline int32_t to_units(int32_t ratio_q30, uint32_t Fc_units)
{
    return dahl_to_units(ratio_q30, Fc_units);
}

/// dahl_counts_between(). A modulus of 0 means 2^32.
inline int32_t counts_between(uint32_t before, uint32_t now, uint32_t modulus = 0)
{
    return dahl_counts_between(before, now, modulus);
}

} // namespace dahl

#endif

#if defined(DAHL_NODE_H) && !defined(DAHL_HPP_NODE)
#define DAHL_HPP_NODE

namespace dahl {

/// Friction node on a CAN bus (dahl_node.h). Call init() first. Calls must not overlap.
class Node {
public:
    /// A node that is not initialized.
    constexpr Node() : node_() {}

    /// dahl_node_init()
    DAHL_NODISCARD dahl_err_t init(const dahl_params_t &params, uint8_t number = 0)
    {
        return dahl_node_init(&node_, &params, number);
    }

    /// dahl_node_receive()
    bool receive(const dahl_can_frame_t &in, uint32_t now_us, dahl_can_frame_t &out)
    {
        return dahl_node_receive(&node_, &in, now_us, &out);
    }
    /// dahl_node_tick()
    bool tick(uint32_t now_us, dahl_can_frame_t &out)
    {
        return dahl_node_tick(&node_, now_us, &out);
    }
    /// dahl_node_bus_off()
    void bus_off(uint32_t now_us) { dahl_node_bus_off(&node_, now_us); }

    /// The C node: settings, counts, and dahl_node_use_slip() and other models.
    dahl_node_t &c() { return node_; }
    /// The C node.
    constexpr const dahl_node_t &c() const { return node_; }

private:
    dahl_node_t node_;
};

} // namespace dahl

#endif
