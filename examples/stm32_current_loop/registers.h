/* SPDX-License-Identifier: MIT */
/* Registers of an STM32F4 that current_loop.c uses; offsets as in RM0090. Replace this file by the CMSIS header of your part.
 * With HOST_REGISTERS they are plain variables, for a test on a PC. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

typedef struct {
    volatile uint32_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR1;
} timer_registers_t;

typedef struct {
    volatile uint32_t SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR[3], JSQR, JDR1;
} adc_registers_t;

#ifdef HOST_REGISTERS
extern timer_registers_t tim1, tim3;
extern adc_registers_t adc1;
#define TIM1 (&tim1)
#define TIM3 (&tim3)
#define ADC1 (&adc1)
#else
#define TIM1 ((timer_registers_t *)0x40010000u)
#define TIM3 ((timer_registers_t *)0x40000400u)
#define ADC1 ((adc_registers_t *)0x40012000u)
#endif

#define TIM_SMCR_ENCODER_MODE_3 3u /* counts all edges of both channels */
#define TIM_CCMR1_INPUTS 0x0101u
#define TIM_CR1_CEN 1u
#define ADC_SR_JEOC 4u

#endif
