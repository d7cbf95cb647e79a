#include "gimbal_attitude.h"

#include <math.h>

/* Half a turn, rad, below which two terms of the series of sine and cosine are exact in a float. */
static const float SMALL = 0.02f;

void gimbal_product(const float a[4], const float b[4], float out[4])
{
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

void gimbal_inverse(const float a[4], float out[4])
{
    out[0] = a[0];
    for (int i = 1; i < 4; ++i) {
        out[i] = -a[i];
    }
}

void gimbal_turn(struct gimbal_attitude *attitude, const float turn[3])
{
    float *q = attitude->q;
    const float angle = sqrtf(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    const float half = 0.5f * angle;
    const float share = half < SMALL ? 0.5f * (1.0f - half * half / 6.0f) : sinf(half) / angle;
    const float less_one = half < SMALL ? -0.5f * half * half : cosf(half) - 1.0f;
    const float step[4] = {less_one, share * turn[0], share * turn[1], share * turn[2]};
    const float longer = 0.5f * (1.0f - (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]));
    float change[4];
    gimbal_product(q, step, change);
    for (int i = 0; i < 4; ++i) {
        const float wanted = change[i] + longer * q[i] - attitude->rest[i];
        const float next = q[i] + wanted;
        attitude->rest[i] = (next - q[i]) - wanted;
        q[i] = next;
    }
}
