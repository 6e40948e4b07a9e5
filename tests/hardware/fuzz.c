/* Hammers a controller with samples of any bits. Its exit code is 0 when every torque was finite, within its limit and
   its rate, and the controller was seen in every state. ARGUMENTS is the number of arrays that a step takes, MOST the
   largest change of a torque, SAMPLES how many to take. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "armgpi_controller.h"

#ifndef SAMPLES
#define SAMPLES 300000
#endif

static uint64_t seed = 1;

static uint64_t bits(void)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return seed;
}

/* Mostly a number near the last one, now and then a jump, and anything that fits into the type. */
static armgpi_real_t number(armgpi_real_t last)
{
    const uint64_t kind = bits() % 4000;
    const uint64_t any = bits();
    armgpi_real_t x = last + (armgpi_real_t)((double)(bits() % 2001) * 1e-7 - 1e-4);

    if (kind == 0) {
        memcpy(&x, &any, sizeof x);
    } else if (kind == 1) {
        x = (armgpi_real_t)((double)(bits() % 2000001) * 1e-3 - 1e3);
    }
    return x;
}

static armgpi_state_t state;
static armgpi_real_t in[ARGUMENTS][ARMGPI_N];

int main(void)
{
    armgpi_real_t tau[ARMGPI_N], last[ARMGPI_N] = {0};
    unsigned long seen[5] = {0, 0, 0, 0, 0};
    long k;
    uint32_t i, j;

    for (k = 0; k < SAMPLES; ++k) {
        armgpi_status_t status;
        int damaged = 0;

        for (i = 0; i < ARGUMENTS; ++i) {
            for (j = 0; j < ARMGPI_N; ++j) {
                in[i][j] = number(fabs((double)in[i][j]) < 1 ? in[i][j] : 0);
            }
        }
        if (k % 50000 == 49999) { /* memory that was damaged */
            unsigned char *byte = (unsigned char *)&state;
            for (i = (uint32_t)(4 * sizeof(uint32_t)); i < sizeof state; ++i) byte[i] = (unsigned char)bits();
            damaged = 1;
        }
        status = STEP(&state, tau);
        ++seen[status];
        for (j = 0; j < ARMGPI_N; ++j) {
            if (!(tau[j] >= -armgpi_info.effort[j] && tau[j] <= armgpi_info.effort[j])) {
                printf("step %ld: torque %g of joint %u\n", k, (double)tau[j], (unsigned)j);
                return 1;
            }
            if (!damaged && fabs((double)tau[j] - (double)last[j]) > MOST) {
                printf("step %ld: torque of joint %u from %g to %g\n", k, (unsigned)j, (double)last[j], (double)tau[j]);
                return 1;
            }
            last[j] = tau[j];
        }
        if (status == ARMGPI_STATUS_HOLD || (status == ARMGPI_STATUS_FAULT && bits() % 4 == 0)) INIT(&state);
        if (damaged) {
            (void)memset(&state, 0, sizeof state);
            for (j = 0; j < ARMGPI_N; ++j) last[j] = 0;
        }
    }
    printf("run %lu, stopping %lu, hold %lu, fault %lu\n", seen[1], seen[2], seen[3], seen[4]);
    return seen[1] > 1000 && seen[2] > 100 && seen[3] > 10 && seen[4] > 100 ? 0 : 1;
}
