// SPDX-License-Identifier: MIT
// Friction compensation for SimpleFOC (Arduino-FOC) 2.4.0, the first version with feed_forward_current. Copy this file into
// your sketch, and pack the library by port/arduino/pack.sh. The motor needs a torque controller by current, since the torque
// is added to feed_forward_current.q [A], which SimpleFOC does not limit: `limit` of the parameters does.
// Checked against the source of 2.4.0 (FOCMotor.h, Sensor.h, loopFOC):
// - It does not initialize feed_forward_current. A global motor starts at 0; for any other, assign {0, 0} before init().
// - loopFOC() adds feed_forward_current to current_sp in place. If it ran twice without move(), it would add twice: keep
//   motion_downsample at 0.
//
//   FrictionCompensator compensator(motor, 0.05f, 16384);                     // N m/A, counts of the sensor in a turn
//   setup():  after initFOC(): if (compensator.init(params) != 0) motor.disable();
//   loop():   motor.loopFOC(); motor.move(target); compensator.loop();        // more often than params.period
#ifndef FRICTION_COMPENSATOR_H
#define FRICTION_COMPENSATOR_H

#include <SimpleFOC.h>
#include <dahl_compensator.h>
#include <dahl_encoder.h>
#include <math.h>

// Counts of the sensor of a motor.
class SensorCounts {
  public:
    // Returns false if counts_per_turn is out of range.
    bool init(uint32_t counts_per_turn)
    {
        counts_per_turn_ = counts_per_turn;
        return dahl_encoder_init(&encoder_, counts_per_turn, +1, 0) == DAHL_OK;
    }

    // Counts since the last call, in the direction of the motor, from the angle within a turn, which keeps its resolution after
    // many turns. The angle of an `Encoder` has the sign of its counter: -2 pi to 2 pi.
    int32_t moved(FOCMotor &motor)
    {
        long counts = lroundf(motor.sensor->getMechanicalAngle() / 6.2831853f * static_cast<float>(counts_per_turn_));
        long turn = static_cast<long>(counts_per_turn_);
        uint32_t reading = static_cast<uint32_t>((counts % turn + turn) % turn);
        return dahl_encoder_move(&encoder_, reading) * static_cast<int32_t>(motor.sensor_direction);
    }

  private:
    uint32_t counts_per_turn_ = 0;
    dahl_encoder_t encoder_ = {};
};

class FrictionCompensator {
  public:
    FrictionCompensator(FOCMotor &motor, float torque_per_ampere, uint32_t counts_per_turn)
        : motor_(motor), torque_per_ampere_(torque_per_ampere), counts_per_turn_(counts_per_turn)
    {
    }

    // Start with the measured law. theta_per_count is set here; set the other parameters, also inertia and delay: the time
    // from the sensor to the torque, with half a period of params.period for the loop that calls it. Returns 0, a code of
    // dahl_prepare() or dahl_compensator_prepare(), or 1: counts_per_turn.
    int init(dahl_compensator_params_t params)
    {
        params.law = DAHL_COMPENSATOR_MEASURED;
        params.friction.theta_per_count = 6.2831853f / static_cast<float>(counts_per_turn_);
        Fc_ = params.friction.Fc;
        period_us_ = static_cast<uint32_t>(params.period * 1e6f + 0.5f);
        last_us_ = static_cast<uint32_t>(_micros());
        int code = dahl_prepare(&friction_, &params.friction);
        if (code == DAHL_OK && !sensor_.init(counts_per_turn_)) {
            code = 1;
        }
        return code != DAHL_OK ? code : dahl_compensator_prepare(&plan_, &params);
    }

    // Update the feed-forward current once in each period. is_good: false if the sensor reports an error; its angle is then
    // not read.
    void loop(bool is_good = true)
    {
        if (static_cast<uint32_t>(_micros()) - last_us_ < period_us_) {
            return;
        }
        last_us_ += period_us_;
        is_good = is_good && motor_.enabled;
        int32_t move = dahl_compensator_move(&plan_, &compensator_, is_good ? sensor_.moved(motor_) : 0, is_good);
        int32_t w = dahl_step_counts_q30(&friction_, &bristle_, move);
        float torque = static_cast<float>(dahl_compensator_torque(&plan_, &compensator_, w)) * DAHL_Q30 * Fc_;
        motor_.feed_forward_current.q += torque / torque_per_ampere_ - current_; // keeps the share of other terms
        current_ = torque / torque_per_ampere_;
    }

    // A, the share of the compensator.
    float current() const
    {
        return current_;
    }

    const dahl_compensator_t &telemetry() const
    {
        return compensator_;
    }

  private:
    FOCMotor &motor_;
    float torque_per_ampere_, Fc_ = 0, current_ = 0; // N m/A, N m, A
    uint32_t counts_per_turn_, period_us_ = 0, last_us_ = 0;
    dahl_plan_t friction_ = {};
    dahl_state_t bristle_ = {};
    SensorCounts sensor_;
    dahl_compensator_plan_t plan_ = {};
    dahl_compensator_t compensator_ = {};
};

#endif
