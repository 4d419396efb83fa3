// SPDX-License-Identifier: MIT
// The members of SimpleFOC 2.4 that FrictionCompensator and AxisCommission use, with their types.
#ifndef SIMPLEFOC_H
#define SIMPLEFOC_H

#include <cstdint>

struct DQCurrent_s {
    float d, q;
};

enum Direction : int8_t { CW = 1, CCW = -1, UNKNOWN = 0 };

enum MotionControlType : uint8_t { torque = 0x00, velocity = 0x01, angle = 0x02 };

struct Sensor {
    float angle = 0; // rad, 0 .. 2 pi
    virtual float getMechanicalAngle() { return angle; }
    virtual ~Sensor() {}
};

class FOCMotor {
  public:
    DQCurrent_s feed_forward_current = {0, 0};
    float target = 0;
    MotionControlType controller = angle;
    int8_t enabled = 1;
    Direction sensor_direction = CW;
    Sensor *sensor = nullptr;
    virtual ~FOCMotor() {}
};

extern unsigned long clock_us;
inline unsigned long _micros() { return clock_us; }

#endif
