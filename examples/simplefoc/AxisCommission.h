// SPDX-License-Identifier: MIT
// A motor with SimpleFOC (Arduino-FOC) 2.4.0 measures its own friction, then cancels it. Copy this file, FrictionCompensator.h,
// and axis.h and axis.c of examples/commission_axis into your sketch; pack the library by port/arduino/pack.sh. The motor needs
// a torque controller by current (TorqueControlType::foc_current). Clear twice the travel to both sides.
//
//   AxisCommission axis(motor, 0.05f, 16384);                           // N m/A, counts of the sensor in a turn
//   setup():  after initFOC(): if (axis.init(config, 35) != DAHL_COMMISSION_OK) motor.disable();   // config: dahl_commission.h
//   loop():   motor.loopFOC(); axis.loop(); motor.move();               // more often than config.period
//   After 24 s: axis.state().is_compensating, or axis.state().command.refusal says what to change (docs/commissioning.md).
#ifndef AXIS_COMMISSION_H
#define AXIS_COMMISSION_H

#include "FrictionCompensator.h"
#include "axis.h"

class AxisCommission {
  public:
    AxisCommission(FOCMotor &motor, float torque_per_ampere, uint32_t counts_per_turn)
        : motor_(motor), torque_per_ampere_(torque_per_ampere), counts_per_turn_(counts_per_turn)
    {
    }

    // Start at rest, in the middle of the travel. theta_per_count is set here.
    dahl_commission_refusal_t init(dahl_commission_config_t config, float loop_hz)
    {
        config.theta_per_count = 6.2831853f / static_cast<float>(counts_per_turn_);
        period_us_ = static_cast<uint32_t>(config.period * 1e6f + 0.5f);
        last_us_ = static_cast<uint32_t>(_micros());
        motor_.controller = MotionControlType::torque;
        motor_.target = 0;
        if (!sensor_.init(counts_per_turn_)) {
            return DAHL_COMMISSION_PARAM;
        }
        return axis_start(&axis_, &config, loop_hz);
    }

    // Update the target of the motor once in each period: `torque` in N m is that of your own loop, after the commissioning.
    void loop(float torque = 0, bool is_good = true)
    {
        if (static_cast<uint32_t>(_micros()) - last_us_ < period_us_) {
            return;
        }
        last_us_ += period_us_;
        is_good = is_good && motor_.enabled;
        float friction = axis_tick(&axis_, is_good ? sensor_.moved(motor_) : 0, is_good);
        motor_.target = (friction + (axis_.is_compensating ? torque : 0)) / torque_per_ampere_;
    }

    const axis_t &state() const
    {
        return axis_;
    }

  private:
    FOCMotor &motor_;
    float torque_per_ampere_; // N m/A
    uint32_t counts_per_turn_, period_us_ = 0, last_us_ = 0;
    SensorCounts sensor_;
    axis_t axis_ = {};
};

#endif
