/* Random and hostile states for an exported controller, to be built with the address and undefined-behaviour
   sanitizers: hostile COUNT. It ends with 1 where a torque is no number or beyond its limit. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gimbal_controller.h"
#include "gimbal_link.h"

static uint32_t seed = 1u;

static uint32_t next(void)
{
    seed ^= seed << 13; /* Marsaglia's xorshift, 2003 */
    seed ^= seed >> 17;
    seed ^= seed << 5;
    return seed;
}

static float drawn(float size)
{
    return size * ((float)(next() >> 8) / 8388608.0f - 1.0f);
}

/* A value of the size given, or, one time in `rare`, one that no sensor gives. */
static float hostile(float size, uint32_t rare)
{
    const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e30f, 1e-42f, 1e5f, 0.0f, -0.0f};
    return next() % rare == 0u ? odd[next() % (sizeof odd / sizeof odd[0])] : drawn(size);
}

static void fill(float x[], int count, float size, uint32_t rare)
{
    for (int i = 0; i < count; ++i) {
        x[i] = hostile(size, rare);
    }
}

static void draw(struct gimbal_sensors *seen, uint32_t rare)
{
    const struct gimbal_sensors before = *seen;
    fill(seen->q, GIMBAL_JOINTS, 4.0f, rare);
    fill(seen->camera_gyro, 3, 1.0f, rare);
    fill(seen->base_gyro, 3, 1.0f, rare);
    fill(seen->base_force, 3, 15.0f, rare);
    fill(seen->link_gyro[0], 3 * GIMBAL_LINKS, 1.0f, rare);
    if (next() % 8u == 0u) {
        *seen = before; /* everything is frozen */
    }
    seen->time_us = next() % 50u == 0u ? next() : before.time_us + 1000u;
}

static int wrong(const float tau[], int k)
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        if (!(fabsf(tau[j]) <= gimbal_default_parameters.limit[j])) {
            printf("step %d: joint %d gets %g N m\n", k, j, (double)tau[j]);
            return 1;
        }
    }
    return 0;
}

int main(int count, char **words)
{
    static struct gimbal_holding holding;
    struct gimbal_tracking tracking;
    struct gimbal_sensors seen;
    struct gimbal_attitudes known;
    const struct gimbal_parameters *p = &gimbal_default_parameters;
    const int steps = count > 1 ? atoi(words[1]) : 100000;
    float tau[GIMBAL_JOINTS];
    static struct gimbal_link link;
    memset(&seen, 0, sizeof seen);
    gimbal_link_start(&link);
    gimbal_tracking_start(&tracking);
    for (int k = 0; k < steps; ++k) {
        const uint32_t rare = 2u + next() % 1000u;
        if (k % 1000 == 0) {
            draw(&seen, k % 2000 ? 5u : 1000000u);
            gimbal_attitudes_level(p, &seen, &known);
            if (k % 3000 == 0) {
                gimbal_attitudes_now(seen.q, &known);
            }
            gimbal_holding_start(p, &holding, &seen, &known);
        }
        draw(&seen, rare);
        gimbal_holding_step(p, &holding, &seen, tau);
        if (wrong(tau, k)) {
            return 1;
        }
        uint8_t bytes[64];
        for (size_t i = 0; i < sizeof bytes; ++i) {
            bytes[i] = (uint8_t)(next() % 16u == 0u ? next() % 4u : next());
        }
        (void)gimbal_link_receive(&link, bytes, sizeof bytes);
        struct gimbal_reference reference;
        fill(reference.q, GIMBAL_JOINTS, 4.0f, rare);
        fill(reference.v, GIMBAL_JOINTS, 4.0f, rare);
        fill(reference.a, GIMBAL_JOINTS, 40.0f, rare);
        gimbal_tracking_step(p, &tracking, hostile(100.0f, rare), seen.q, reference.v, &reference, tau);
        if (wrong(tau, k)) {
            return 1;
        }
    }
    printf("%d steps, every torque a number within its limit\n", steps);
    return 0;
}
