/* Attitudes as unit quaternions (w, x, y, z), turns as rotation vectors, rad. */
#ifndef GIMBAL_ATTITUDE_H
#define GIMBAL_ATTITUDE_H

#include "gimbal_controller.h"

/* out = a b; out may be neither. */
void gimbal_product(const float a[4], const float b[4], float out[4]);

/* out = the inverse of a. */
void gimbal_inverse(const float a[4], float out[4]);

/* attitude <- attitude exp(turn), of unit length again. What a float cannot hold of the change is kept for the next
   turn (Kahan 1965): else a million small turns would walk away by as many roundings. Do not build with -ffast-math. */
void gimbal_turn(struct gimbal_attitude *attitude, const float turn[3]);

#endif
