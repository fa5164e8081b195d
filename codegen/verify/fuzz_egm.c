/* libFuzzer: any bytes as an EGM datagram. */
#include "gt_egm.h"

#include <stddef.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    gt_egm_robot robot;

    (void)gt_egm_read_robot(data, (uint32_t)size, &robot);
    return 0;
}
