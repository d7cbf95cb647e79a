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

/* The shorter of the two turns that an attitude is. */
void gimbal_log(const float attitude[4], float turn[3]);

/* Quaternion of a rotation matrix, by the largest of its four parts (Shepperd 1978). */
void gimbal_quaternion(const float R[9], float out[4]);

/* out = R^T x. */
void gimbal_back(const float R[9], const float x[3], float out[3]);

#endif
