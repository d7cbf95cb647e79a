// Floating-point operations of a step that holds the camera: the most of a hundred steps.
#include "counted.hpp"

long operations = 0;

#include "gimbal_attitude.c"
#include "gimbal_guard.c"
#include "gimbal_holding.c"
#include "gimbal_law.c"
#include "gimbal_model.c"
#include "gimbal_parameters.c"

int main()
{
    static struct gimbal_holding state;
    static struct gimbal_sensors seen;
    struct gimbal_attitudes known;
    float tau[GIMBAL_JOINTS];
    long most = 0;
    seen.base_force[2] = 9.81f;
    gimbal_attitudes_level(&gimbal_default_parameters, &seen, &known);
    gimbal_holding_start(&gimbal_default_parameters, &state, &seen, &known);
    for (int k = 1; k <= 100; ++k) {
        const float x = 1e-5f * (float)k; // no reading repeats itself
        seen.time_us += 1000u;
        seen.q[0] = x;
        seen.camera_gyro[0] = x;
        seen.base_gyro[0] = 2.0f * x;
        seen.base_force[0] = 3.0f * x;
        seen.link_gyro[0][0] = x;
        operations = 0;
        gimbal_holding_step(&gimbal_default_parameters, &state, &seen, tau);
        most = operations > most ? operations : most;
    }
    printf("%ld\n", most);
}
