/* gt_bounds: see gt_bounds.h. */
#include "gt_bounds.h"

#include <math.h>

int gt_bounds_apart(const gt_loop *loop)
{
    int apart = 0;
    uint32_t n;

    for (n = 0U; (loop->command.along_path == 0) && (n < loop->peer.axes); n++) {
        if (!(fabs(loop->feedback.position_m[n] - loop->sent_m[n]) <= loop->settings.limits.following_m)) {
            apart = 1;
        }
    }
    return apart;
}

int gt_bounds_allow(const gt_loop *loop, const gt_command *command)
{
    const gt_limits *limits = &loop->settings.limits;
    const double seconds = (double)loop->peer.cycle_ms / 1000.0;
    int allowed = 1;
    uint32_t n;

    for (n = 0U; (command->along_path != 0) && (n < 3U); n++) {
        if (!(fabs(command->path_m[n]) <= limits->path_m)) {
            allowed = 0;
        }
    }
    for (n = 0U; (command->along_path == 0) && (n < loop->peer.axes); n++) {
        const double step = command->position_m[n] - loop->command.position_m[n];

        if (!(command->position_m[n] >= limits->lowest_m[n]) || !(command->position_m[n] <= limits->highest_m[n]) ||
            !(fabs(step) <= limits->step_m) || !(fabs(command->position_m[n] - loop->sent_m[n]) <= limits->step_m) ||
            !(fabs(command->speed_m_s[n] * seconds) <= limits->step_m)) {
            allowed = 0;
        }
    }
    return allowed;
}
