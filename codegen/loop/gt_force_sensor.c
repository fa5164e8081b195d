/* gt_force_sensor: see gt_force_sensor.h. */
#include "gt_force_sensor.h"

#define GT_ORTHONORMAL 1e-6

int gt_force_sensor_of(gt_force_sensor *sensor, const double *numbers)
{
    gt_copy(sensor->turn, numbers, 9);
    sensor->point_m = gt_vector_at(&numbers[9]);
    sensor->bias_N = gt_vector_at(&numbers[12]);
    sensor->bias_N_m = gt_vector_at(&numbers[15]);
    sensor->mass_kg = numbers[18];
    sensor->first_moment_kg_m = gt_vector_at(&numbers[19]);
    return gt_all_finite(numbers, (int)GT_FORCE_SENSOR_NUMBERS) && (sensor->mass_kg >= 0.0) &&
           gt_is_turn(sensor->turn, GT_ORTHONORMAL);
}

void gt_force_sensor_wrench(const gt_force_sensor *sensor, const gt_wrench *reading, const double *turn,
                            gt_vector gravity, gt_vector *force_N, gt_vector *moment_N_m)
{
    const gt_vector g = gt_turned_back(sensor->turn, gt_turned_back(turn, gravity));
    const gt_vector force =
        gt_plus(gt_plus(gt_vector_at(reading->force_N), -1.0, sensor->bias_N), -sensor->mass_kg, g);
    gt_vector moment = gt_plus(gt_vector_at(reading->moment_N_m), -1.0, sensor->bias_N_m);

    moment = gt_plus(moment, -1.0, gt_cross(sensor->first_moment_kg_m, g));
    moment = gt_plus(moment, -1.0, gt_cross(sensor->point_m, force));
    *force_N = gt_turned(turn, gt_turned(sensor->turn, force));
    *moment_N_m = gt_turned(turn, gt_turned(sensor->turn, moment));
}

gt_wrench_status gt_force_sensor_sign(const gt_force_sensor *sensor, const gt_wrench *reading, const double *turn,
                                      gt_vector gravity, double drift_N)
{
    const gt_vector g = gt_turned_back(sensor->turn, gt_turned_back(turn, gravity));
    const gt_vector pull = gt_plus(gt_vector_at(reading->force_N), -1.0, sensor->bias_N);
    const double size = gt_length(g);
    gt_wrench_status status = GT_WRENCH_NO_FORCE;

    if ((sensor->mass_kg * size) > drift_N) {
        const double along = gt_dot(pull, g) / size;
        const gt_vector off = gt_plus(pull, -sensor->mass_kg, g);

        if (along > drift_N) {
            status = (gt_length(off) > (drift_N + (GT_OTHER_LOAD * sensor->mass_kg * size))) ? GT_WRENCH_WRONG_LOAD
                                                                                            : GT_WRENCH_OK;
        } else if (along < -drift_N) {
            status = GT_WRENCH_WRONG_SIGN;
        } else {
            /* it does not tell */
        }
    }
    return status;
}
