/* SPDX-License-Identifier: MIT */
/*
 * true_friction: the friction of a simulated machine, in double precision and without code of the library:
 *   Dahl      dF/dtheta = sigma0 (1 - F/Fc sgn(omega))
 *   LuGre     dz/dt = omega - sigma0 |omega| z/g,  g = Fc + (break - Fc) exp(-(omega/stribeck)^2),  F = sigma0 z + sigma1 dz/dt
 *   Maxwell   slip elements in parallel, on Dahl's curve from rest up to three presliding lengths
 */
#ifndef TRUE_FRICTION_H
#define TRUE_FRICTION_H

#define MAXWELL_ELEMENTS 8

typedef enum { DAHL_TRUE_DAHL, DAHL_TRUE_LUGRE, DAHL_TRUE_MAXWELL } true_friction_kind_t;

typedef struct {
    true_friction_kind_t kind;
    double sigma0, Fc;          /* N m/rad, N m */
    double breakaway, stribeck; /* LuGre: N m, rad/s */
    double sigma1;              /* LuGre: N m s/rad */
} true_friction_params_t;

typedef struct {
    double torque;                          /* N m, with the sign of the motion */
    double deflection;                      /* LuGre: z in rad */
    double forces[MAXWELL_ELEMENTS];        /* N m */
    double limits[MAXWELL_ELEMENTS];        /* N m */
    double stiffnesses[MAXWELL_ELEMENTS];   /* N m/rad */
} true_friction_t;

/* Start relaxed. */
void dahl_true_friction_open(const true_friction_params_t *params, true_friction_t *friction);

/* Move by dtheta rad at a constant speed within dt s. */
void dahl_true_friction_move(const true_friction_params_t *params, true_friction_t *friction, double dtheta, double dt);

#endif
