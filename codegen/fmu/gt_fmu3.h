/* What the two files of FMI 3.0 have in common. */
#ifndef GT_FMU3_H
#define GT_FMU3_H

#include "gt_fmu.h"

#include "fmi3Functions.h"

#endif
