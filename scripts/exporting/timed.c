/* Time of a step that holds the camera, microseconds: the least of ten means over ten thousand. */
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "gimbal_controller.h"

int main(void)
{
    static struct gimbal_holding state;
    struct gimbal_sensors seen;
    struct gimbal_attitudes known;
    float tau[GIMBAL_JOINTS];
    double least = 1e9;
    memset(&seen, 0, sizeof seen);
    seen.base_force[2] = 9.81f;
    gimbal_attitudes_level(&gimbal_default_parameters, &seen, &known);
    gimbal_holding_start(&gimbal_default_parameters, &state, &seen, &known);
    for (int pass = 0; pass < 10; ++pass) {
        const clock_t begun = clock();
        for (int k = 0; k < 10000; ++k) {
            const float x = 1e-5f * (float)(k % 1000); /* no reading repeats itself */
            seen.time_us += 1000u;
            seen.q[0] = x;
            seen.camera_gyro[0] = x;
            seen.base_gyro[0] = 2.0f * x;
            seen.base_force[0] = 3.0f * x;
            seen.link_gyro[0][0] = x;
            gimbal_holding_step(&gimbal_default_parameters, &state, &seen, tau);
        }
        const double mean = 1e6 * (double)(clock() - begun) / (double)CLOCKS_PER_SEC / 10000.0;
        least = mean < least ? mean : least;
    }
    printf("%.3f\n", least);
    return 0;
}
