/* Frama-C Eva: gt_rsi_read_robot for any datagram of 0 to GT_DATAGRAM_MAX bytes. Not part of any program. */
#include "__fc_builtin.h"
#include "gt_rsi.h"
#include "gt_wire.h"

int main(void)
{
    uint8_t data[GT_DATAGRAM_MAX];
    gt_rsi_robot robot;
    const uint32_t length = Frama_C_unsigned_int_interval(0U, GT_DATAGRAM_MAX);

    Frama_C_make_unknown((char *)data, sizeof(data));
    return gt_rsi_read_robot(data, length, &robot);
}
