/* Hammers a controller with samples of any bits. Its exit code is 0 when every torque was finite and within its
   limit, and the controller was seen in RUN and in FAULT. ARGUMENTS is the number of arrays that a step takes. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "armgpi_controller.h"

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
    const uint64_t kind = bits() % 1000;
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
    armgpi_real_t tau[ARMGPI_N];
    unsigned long seen[3] = {0, 0, 0};
    long k;
    uint32_t i, j;

    for (k = 0; k < 300000; ++k) {
        armgpi_status_t status;

        for (i = 0; i < ARGUMENTS; ++i) {
            for (j = 0; j < ARMGPI_N; ++j) {
                in[i][j] = number(state.status == ARMGPI_STATUS_RUN && in[i][j] == in[i][j] ? in[i][j] : 0);
            }
        }
        if (k % 50000 == 49999) { /* memory that was damaged */
            unsigned char *byte = (unsigned char *)&state;
            for (i = (uint32_t)(3 * sizeof(uint32_t)); i < sizeof state; ++i) byte[i] = (unsigned char)bits();
        }
        status = STEP(&state, tau);
        ++seen[status];
        for (j = 0; j < ARMGPI_N; ++j) {
            if (!(tau[j] >= -armgpi_info.effort[j] && tau[j] <= armgpi_info.effort[j])) {
                printf("step %ld: torque %g of joint %u\n", k, (double)tau[j], (unsigned)j);
                return 1;
            }
        }
        if (status != ARMGPI_STATUS_RUN && bits() % 4 == 0) INIT(&state);
    }
    printf("run %lu, fault %lu\n", seen[1], seen[2]);
    return seen[1] > 1000 && seen[2] > 100 ? 0 : 1;
}
