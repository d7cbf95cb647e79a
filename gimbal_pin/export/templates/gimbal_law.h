/* The control laws: from where the joints are and should be to torques. */
#ifndef GIMBAL_LAW_H
#define GIMBAL_LAW_H

#include "gimbal_controller.h"

/* Where the model is to be evaluated: the middle of the hold of a torque. */
struct gimbal_ahead {
    float q[GIMBAL_JOINTS]; /* rad */
    float v[GIMBAL_JOINTS]; /* wanted rates, rad/s */
    float a[GIMBAL_JOINTS]; /* wanted accelerations, rad/s^2 */
    float f[3];             /* specific force of the base, m/s^2 */
    float w[3];             /* its rate, rad/s */
    float dw[3];            /* its angular acceleration, rad/s^2 */
};

/* Where the joints should be so that the camera looks where it should. */
struct gimbal_aim {
    float q[GIMBAL_JOINTS]; /* rad */
    float v[GIMBAL_JOINTS]; /* rad/s */
    struct gimbal_ahead ahead[GIMBAL_LEADS];
};

/* Where the camera should look at one moment. */
struct gimbal_gaze {
    float attitude[4]; /* in the wanted frame */
    float w[3];        /* rate in its own frame, rad/s */
    float dw[3];       /* angular acceleration in its own frame, rad/s^2 */
};

/* The camera at some angles. */
struct gimbal_view {
    float R[9];                       /* its attitude in the base link */
    float against[3 * GIMBAL_JOINTS]; /* rates of the joints that undo a turn of the camera, joint by joint */
    bool steep;                       /* whether the pose is near a singular one and the inverse damped */
};

/* Errors of one sample. */
struct gimbal_error {
    float angle[GIMBAL_JOINTS];    /* rad */
    float rate[GIMBAL_JOINTS];     /* rad/s */
    float integral[GIMBAL_JOINTS]; /* with this sample, rad s */
};

/* Computed torque on a base that moves. */
void gimbal_hold(const struct gimbal_parameters *p, struct gimbal_memory *memory, float t,
                 const float q[GIMBAL_JOINTS], const float v[GIMBAL_JOINTS], const struct gimbal_aim *aim,
                 float tau[GIMBAL_JOINTS]);

/* Whether all of some values are numbers. */
bool gimbal_finite(const float x[], int count);

#endif
