#include "gimbal_law.h"

#include <math.h>

#include "gimbal_model.h"

bool gimbal_finite(const float x[], int count)
{
    bool finite = true;
    for (int i = 0; i < count; ++i) {
        finite = finite && isfinite(x[i]);
    }
    return finite;
}

/* What to command so that a drive gives a torque, N m. */
static float commanded(const struct gimbal_drive *drive, float torque)
{
    if (drive->count < 2) {
        return torque;
    }
    const struct gimbal_point *points = &gimbal_drive_points[drive->first];
    int low = 0;
    int high = drive->count - 1;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (points[middle].torque <= torque) {
            low = middle;
        } else {
            high = middle;
        }
    }
    const float share = (torque - points[low].torque) / (points[high].torque - points[low].torque);
    return points[low].command + share * (points[high].command - points[low].command);
}

/* --- Following a reference ---------------------------------------------------------------------------------------- */

void gimbal_tracking_start(struct gimbal_tracking *state)
{
    *state = (struct gimbal_tracking){.begun = false};
}

void gimbal_tracking_step(const struct gimbal_parameters *p, struct gimbal_tracking *state, float t,
                          const float q[GIMBAL_JOINTS], const float v[GIMBAL_JOINTS],
                          const struct gimbal_reference *reference, float tau[GIMBAL_JOINTS])
{
    struct gimbal_error error;
    float ahead[GIMBAL_JOINTS];
    float y[GIMBAL_JOINTS];
    float wanted[GIMBAL_JOINTS];
    bool numbers = true;
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float change = state->begun ? reference->a[j] - state->acceleration[j] : 0.0f;
        ahead[j] = reference->a[j] + p->tracking_lead[j] / p->dt * change;
        numbers = numbers && fabsf(q[j]) < p->limits.farthest && fabsf(v[j]) < p->limits.farthest;
    }
    gimbal_feedback(p, p->tracking, &p->robust, q, v, reference->q, reference->v, state->integral, ahead, &error, y);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        wanted[j] = p->tracking[j].inertia * y[j];
        y[j] += ahead[j];
    }
    if (p->law == GIMBAL_COMPUTED_TORQUE) {
        gimbal_standing_torque(p, &p->terms, t, q, v, y, reference, wanted);
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            wanted[j] = commanded(&p->drive[j], wanted[j]);
        }
    }
    gimbal_cut_torque(p, p->tracking, &error, wanted, state->integral, tau);
    numbers = numbers && gimbal_finite(wanted, GIMBAL_JOINTS) && gimbal_finite(error.angle, GIMBAL_JOINTS) &&
              gimbal_finite(error.rate, GIMBAL_JOINTS) && gimbal_finite(state->integral, GIMBAL_JOINTS) &&
              gimbal_finite(reference->a, GIMBAL_JOINTS);
    if (!numbers) {
        *state = (struct gimbal_tracking){.refused = state->refused + 1u};
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        tau[j] = numbers ? tau[j] : 0.0f;
        state->acceleration[j] = numbers ? reference->a[j] : 0.0f;
    }
    state->begun = numbers;
}

/* --- Holding the camera on a base that moves ---------------------------------------------------------------------- */

void gimbal_hold(const struct gimbal_parameters *p, struct gimbal_memory *memory, float t,
                 const float q[GIMBAL_JOINTS], const float v[GIMBAL_JOINTS], const struct gimbal_aim *aim,
                 float tau[GIMBAL_JOINTS])
{
    struct gimbal_error error;
    float y[GIMBAL_JOINTS];
    float wanted[GIMBAL_JOINTS] = {0.0f};
    float moment[GIMBAL_JOINTS];
    gimbal_feedback(p, p->holding, &p->robust, q, v, aim->q, aim->v, memory->integral, aim->ahead[0].a, &error, y);
    for (int lead = 0; lead < GIMBAL_LEADS; ++lead) {
        gimbal_moving_torque(p, &p->terms, t, &aim->ahead[lead], y, moment);
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            if (p->lead_of[j] == lead) {
                wanted[j] = commanded(&p->drive[j], moment[j]) + p->lasting * memory->owed[j];
            }
        }
    }
    gimbal_cut_torque(p, p->holding, &error, wanted, memory->integral, tau);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float most = p->most_owed * p->limit[j];
        memory->owed[j] = fmaxf(-most, fminf(wanted[j] - tau[j], most));
    }
}
