/* A gimbal's main loop. The three functions below are the board's: sensors in, torques out, a clock. */
#include <string.h>

#include "gimbal_controller.h"

static void wait_for_sample(void)
{
    /* sleep until the timer of the sampling interval fires */
}

static void read_sensors(struct gimbal_sensors *seen)
{
    memset(seen, 0, sizeof *seen); /* stamp, encoders, gyros and accelerometer, in the units of the header */
}

static void command_torques(const float tau[GIMBAL_JOINTS])
{
    (void)tau; /* to current loops: tau divided by each motor's torque per ampere */
}

static struct gimbal_holding state;

int main(void)
{
    const struct gimbal_parameters *p = &gimbal_default_parameters;
    struct gimbal_sensors seen;
    struct gimbal_attitudes known;
    float tau[GIMBAL_JOINTS];

    read_sensors(&seen);
    gimbal_attitudes_level(p, &seen, &known);
    gimbal_holding_start(p, &state, &seen, &known);
    for (;;) {
        wait_for_sample();
        read_sensors(&seen);
        gimbal_holding_step(p, &state, &seen, tau);
        command_torques(tau);
    }
}
