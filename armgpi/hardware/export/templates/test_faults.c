/*
 * A test of every fault: a motion in which armgpi's supervisor in Python finds it, and what this C says; or why there
 * is no such motion. Exit code 0 when they agree.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "armgpi_controller.h"

/* Positions q + k dq + k^3 dddq, reference r + k dr, for k = 1, 2, ... up to `samples`; all dither when k is odd. */
struct fault {
    const char *name;
    double q, dq, dddq, r, dr, dither; /* of the joint, beside the middle of its range */
    uint32_t joint, samples, elapsed;
    int nan_q, nan_r;
    uint32_t reason;
    const char *why; /* there is no such motion; else NULL */
};

static const double MIDDLE[ARMGPI_N] = {
$middle
};

static const struct fault FAULTS[] = {
$faults
};

static armgpi_state_t state;

static uint32_t reason_of(const struct fault *fault)
{
    armgpi_real_t $declared;
    armgpi_real_t tau[ARMGPI_N];
    uint32_t i;
    uint32_t k;

    for (i = 0U; i < ARMGPI_N; ++i) {
        q_measured[i] = (armgpi_real_t)MIDDLE[i];
        q_ref[i] = (armgpi_real_t)MIDDLE[i];
$zeroed    }
    q_measured[fault->joint] = (armgpi_real_t)(MIDDLE[fault->joint] + fault->q);
    q_ref[fault->joint] = (armgpi_real_t)(MIDDLE[fault->joint] + fault->r);
    (void)armgpi_init(&state, $arguments);
    for (k = 1U; (k <= fault->samples) && (state.status <= ARMGPI_STATUS_RUN); ++k) {
        const double odd = ((k % 2U) == 1U) ? fault->dither : 0.0;
        const double k2 = (double)k * k;

        for (i = 0U; i < ARMGPI_N; ++i) {
            q_measured[i] = (armgpi_real_t)(MIDDLE[i] + odd);
        }
        q_measured[fault->joint] = (armgpi_real_t)(MIDDLE[fault->joint] + fault->q + k * fault->dq + k * k2 * fault->dddq + odd);
$velocity        q_ref[fault->joint] = (armgpi_real_t)(MIDDLE[fault->joint] + fault->r + k * fault->dr);
        if (fault->nan_q != 0) {
            q_measured[fault->joint] = (armgpi_real_t)NAN;
        }
        if (fault->nan_r != 0) {
            q_ref[fault->joint] = (armgpi_real_t)NAN;
        }
        (void)armgpi_step_late(&state, fault->elapsed, $arguments, tau);
        for (i = 0U; i < ARMGPI_N; ++i) {
            if (!((tau[i] >= -armgpi_info.effort[i]) && (tau[i] <= armgpi_info.effort[i]))) {
                (void)printf("%s: a torque is beyond its limit\n", fault->name);
                return UINT32_MAX;
            }
        }
    }
    return state.reason;
}

int main(void)
{
    static armgpi_state_t never;
    armgpi_real_t $declared_zero;
    armgpi_real_t tau[ARMGPI_N];
    uint32_t failed = 0U;
    uint32_t i;

    for (i = 0U; i < (uint32_t)(sizeof FAULTS / sizeof FAULTS[0]); ++i) {
        uint32_t found;
        int same;

        if (FAULTS[i].why != NULL) {
            (void)printf("%-12s no test: %s\n", FAULTS[i].name, FAULTS[i].why);
            continue;
        }
        found = reason_of(&FAULTS[i]);
        same = (found == FAULTS[i].reason) ? 1 : 0;
        (void)printf("%-12s reason %lu %s\n", FAULTS[i].name, (unsigned long)found, (same != 0) ? "ok" : "DIFFERS");
        failed += (same != 0) ? 0U : 1U;
    }
    (void)armgpi_step(&never, $arguments, tau);
    failed += (never.reason == ARMGPI_REASON_BEFORE_INIT) ? 0U : 1U;
    (void)printf("%lu failed\n", (unsigned long)failed);
    return (failed == 0U) ? 0 : 1;
}
