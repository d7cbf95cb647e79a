#include "gimbal_attitude.h"

#include <math.h>

/* Half a turn, rad, below which two terms of the series of sine, cosine and arc tangent are exact in a float. */
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

void gimbal_log(const float attitude[4], float turn[3])
{
    const float w = fabsf(attitude[0]);
    const float sign = attitude[0] < 0.0f ? -1.0f : 1.0f;
    const float length = sqrtf(attitude[1] * attitude[1] + attitude[2] * attitude[2] + attitude[3] * attitude[3]);
    const float tangent = length / w;
    const float share = tangent < SMALL ? 2.0f / w * (1.0f - tangent * tangent / 3.0f) : 2.0f * atan2f(length, w) / length;
    for (int i = 0; i < 3; ++i) {
        turn[i] = sign * share * attitude[i + 1];
    }
}

void gimbal_quaternion(const float R[9], float out[4])
{
    const float trace = R[0] + R[4] + R[8];
    int largest = 0;
    float most = trace;
    for (int i = 0; i < 3; ++i) {
        if (R[4 * i] > most) {
            most = R[4 * i];
            largest = i + 1;
        }
    }
    if (largest == 0) {
        const float root = 2.0f * sqrtf(fmaxf(1.0f + trace, 1.0f));
        out[0] = 0.25f * root;
        out[1] = (R[7] - R[5]) / root;
        out[2] = (R[2] - R[6]) / root;
        out[3] = (R[3] - R[1]) / root;
        return;
    }
    const int i = largest - 1;
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const float root = 2.0f * sqrtf(fmaxf(1.0f + 2.0f * R[4 * i] - trace, 1.0f));
    out[0] = (R[3 * k + j] - R[3 * j + k]) / root;
    out[1 + i] = 0.25f * root;
    out[1 + j] = (R[3 * j + i] + R[3 * i + j]) / root;
    out[1 + k] = (R[3 * k + i] + R[3 * i + k]) / root;
}

void gimbal_back(const float R[9], const float x[3], float out[3])
{
    for (int i = 0; i < 3; ++i) {
        out[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
    }
}
