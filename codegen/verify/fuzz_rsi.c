/* libFuzzer: any bytes as an RSI telegram. */
#include "gt_rsi.h"

#include <stddef.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    gt_rsi_robot robot;

    (void)gt_rsi_read_robot(data, (uint32_t)size, &robot);
    return 0;
}
