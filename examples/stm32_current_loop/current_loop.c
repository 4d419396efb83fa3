/* SPDX-License-Identifier: MIT */
/*
 * The current loop of a DC motor at 10 kHz with friction compensation, on a bare STM32F4. TIM3 counts a quadrature encoder
 * and wraps at 65536. TIM1 makes the PWM of an H-bridge (50 % is 0 V) and starts the ADC in the middle of a pulse; the
 * interrupt of the ADC runs the loop. A position or speed loop writes torque_command.
 */
#include "current_loop.h"

#include <dahl_compensator.h>
#include <dahl_encoder.h>

#include "registers.h"

#define PERIOD_S 1e-4f
#define TORQUE_PER_AMPERE 0.05f /* N m/A */
#define LIMIT_AMPERE 4.0f
#define AMPERE_PER_LSB (3.3f / 4096 / 0.1f) /* 0.1 V/A */
#define ADC_ZERO 2048.0f
#define BUS_VOLT 24.0f
#define PWM_PERIOD 8400u /* 168 MHz, centre-aligned: 10 kHz */
#define KP 1.0f   /* V/A */
#define KI 500.0f /* V/(A s) */
#define FC_LOW 0.045f        /* N m, from dahl identify */
#define LENGTH_LONG 0.0055f  /* rad, from dahl identify */
#define SIGMA0_HIGH 9.0f     /* N m/rad, from dahl identify */
#define ROTOR_INERTIA 2e-5f  /* kg m2, data sheet */
#define DELAY_S 1.2e-3f      /* a PWM period, and the lag of the current loop: winding L/KP = 1 ms */

static const dahl_compensator_params_t params = {
    .friction = {FC_LOW / LENGTH_LONG, FC_LOW, 6.2831853f / 16384}, /* 4096 lines, 4 edges each */
    .law = DAHL_COMPENSATOR_MEASURED, .Fc_low = FC_LOW, .length_long = LENGTH_LONG,
    .sigma0_high = SIGMA0_HIGH, .load = 0.0f, .inertia = ROTOR_INERTIA, .delay = DELAY_S, .elastic = 0, /* direct drive */
    .gain = 0.9f, .limit = 0.06f, .slew = 5.0f, .period = PERIOD_S, /* N m, N m/s, s */
    .rise = 0.5f, .fall = 0.02f, .fade_speed = 20.0f,               /* s, s, rad/s */
    .noise = 1, .play = 4, .jump = 100};                            /* counts */
static dahl_plan_t friction;
static dahl_state_t bristle;
static dahl_compensator_plan_t plan;
static dahl_compensator_t compensator;
static dahl_encoder_t encoder;
static float integral; /* V */

volatile float torque_command;
volatile int encoder_is_good = 1;
volatile float compensation;

int current_loop_init(void)
{
    int code = dahl_prepare(&friction, &params.friction);
    if (code == DAHL_OK && dahl_encoder_init(&encoder, 65536, +1, 0) != DAHL_OK) {
        code = CURRENT_LOOP_ENCODER;
    }
    code = code != DAHL_OK ? code : dahl_compensator_prepare(&plan, &params);
    TIM3->SMCR = TIM_SMCR_ENCODER_MODE_3;
    TIM3->CCMR1 = TIM_CCMR1_INPUTS;
    TIM3->ARR = 65535;
    TIM3->CR1 = TIM_CR1_CEN;
    return code;
}

static float clamp(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

/* Return the compensation in N m. */
static float compensate(void)
{
    int is_good = encoder_is_good;
    int32_t dcounts = is_good ? dahl_encoder_move(&encoder, TIM3->CNT) : 0;
    int32_t move = dahl_compensator_move(&plan, &compensator, dcounts, is_good);
    int32_t w = dahl_step_counts_q30(&friction, &bristle, move);
    return (float)dahl_compensator_torque(&plan, &compensator, w) * (DAHL_Q30 * FC_LOW);
}

/* PI; the integral stops at the voltage of the bus. Returns V. */
static float control(float error)
{
    integral = clamp(integral + KI * PERIOD_S * error, BUS_VOLT);
    return clamp(KP * error + integral, BUS_VOLT);
}

void ADC_IRQHandler(void)
{
    ADC1->SR = ~ADC_SR_JEOC;
    compensation = compensate();
    float wanted = clamp((torque_command + compensation) / TORQUE_PER_AMPERE, LIMIT_AMPERE);
    float current = ((float)ADC1->JDR1 - ADC_ZERO) * AMPERE_PER_LSB;
    float duty = 0.5f + 0.5f * control(wanted - current) / BUS_VOLT;
    TIM1->CCR1 = (uint32_t)(duty * (float)PWM_PERIOD);
}
