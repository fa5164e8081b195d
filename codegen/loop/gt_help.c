/* All options, for a person; see gt_arguments.h. */
#include "gt_arguments.h"

const char *gt_arguments_help(void)
{
    return "gt_loop --reference|--gains TABLE --log NEW_FILE [options]: answers a robot that speaks ABB EGM or KUKA RSI.\n"
           "Dry unless --live: EGM gets no answer, RSI corrections of zero. Tested against simulators only.\n"
           "  --peer egm|rsi              protocol; egm\n"
           "  --law NAME                  trajectory, dynamics, replay, path, lead_through, predictive; trajectory\n"
           "  --feedforward on|off        off\n"
           "  --live                      send commands\n"
           "  --bind IP --port N          where to listen; 127.0.0.1, any free port\n"
           "  --allow IP                  address of the robot; 127.0.0.1\n"
           "  --beyond-loopback           allow other addresses; needs the limits below\n"
           "  --lowest M,.. --highest M,..  of each cart or joint [m, rad]\n"
           "  --step M --path-limit M     change of a cart or joint in a cycle, path correction [m, rad]; 0.02, 0.01\n"
           "  --following M               of a cart or joint from its last command, else it is braked [m, rad]; 0.25\n"
           "  --cycle-ms N                of the robot; 4\n"
           "  --hold N --ramp N           cycles; 5, 50\n"
           "  --deceleration A            of the fastest cart or joint [m/s2, rad/s2], in place of --ramp\n"
           "  --idle-ms N                 end after so long without a newer datagram; 1000\n"
           "  --cycles N                  end after so many, 0 for never; 0\n"
           "  --a A,.. --b B,.. --delay-ms N  drives of law trajectory\n"
           "  --kp K,.. --kd K,.. --lead-ms N  servo of law dynamics [N/m, N s/m], of joints [N m/rad, N m s/rad]\n"
           "  --corrections TABLE         of law replay\n"
           "  --gain G                    of law path [1/s]\n"
           "  --gains TABLE               of law lead_through, which has no reference\n"
           "  --lockstep                  cycles end with an empty datagram: for tests\n";
}
