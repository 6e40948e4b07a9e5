/*
 * Replay of a log: gives the controller what it was given in a simulation by armgpi and compares its torque
 * with that of the same controller in Python. For the host: it uses stdio.h and time.h, the controller does not.
 *
 *   replay [LOG]      log.armlog by default; also one that armgpi_log_write wrote
 *
 * Exit code 0 when the torques agree, 1 when they do not or the controller met a fault, 2 without a log.
 */
#include <float.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "armgpi_log.h"

/* What precedes the header of a log, and where its length is. */
#define START_BYTES 16U
#define LENGTH_AT 12U
/* Rows that are timed. */
#define TIMED 2000U
/* Largest difference allowed, as a share of the torque scale; 0 when there is none to be kept. */
#define TOLERANCE $tolerance
/* No torque is larger; NaN is not below it. */
#define LARGEST ((armgpi_real_t)1e30)
/* How long to time [s]. */
#define TIMING_SECONDS $seconds

/* What a difference is a share of: the torque limit, or the largest torque in the log where there is none. */
static const double SCALE[ARMGPI_N] = {
$scale
};

static armgpi_real_t timed[TIMED][ARMGPI_INPUTS][ARMGPI_N];
static armgpi_real_t moved[ARMGPI_N];
static volatile armgpi_real_t sink;

/* Go to the first row of a log; return 0 when there is none. */
static int find_rows(FILE *file)
{
    static const uint8_t magic[LENGTH_AT] = {0x41U, 0x52U, 0x4DU, 0x47U, 0x50U, 0x49U, 0x4CU, 0x47U, 1U};
    uint8_t start[START_BYTES];
    int found = (fread(start, 1U, sizeof start, file) == sizeof start) ? 1 : 0;
    long length = 0;
    uint32_t i;

    for (i = 0U; (i < START_BYTES) && (found != 0); ++i) {
        if (i < LENGTH_AT) {
            found = (start[i] == magic[i]) ? 1 : 0;
        } else {
            length += (long)start[i] << (8U * (i - LENGTH_AT));
        }
    }
    return ((found != 0) && (fseek(file, length, SEEK_CUR) == 0)) ? 1 : 0;
}

static armgpi_status_t step(armgpi_state_t *state, armgpi_real_t in[ARMGPI_INPUTS][ARMGPI_N],
    const armgpi_real_t q_ref[ARMGPI_N], armgpi_real_t tau[ARMGPI_N])
{
    return armgpi_step(state, $step_call, tau);
}

/* Return the mean time of a step [ns], with the reference moved by `shift`. After a fault, as torque that stays
   at its limits is one, the controller is started anew; -1 when that is too often. */
static double time_steps(uint32_t rows, armgpi_real_t shift)
{
    static armgpi_state_t state;
    armgpi_real_t tau[ARMGPI_N];
    double spent = 0.0;
    double steps = 0.0;
    double faults = 0.0;
    const clock_t begun = clock();

    while (spent < TIMING_SECONDS) {
        uint32_t k;

        for (k = 0U; k < rows; ++k) {
            uint32_t j;

            for (j = 0U; j < ARMGPI_N; ++j) {
                moved[j] = timed[k][$q_ref][j] + shift;
            }
            if (k == 0U) {
                (void)armgpi_init(&state, $init_now);
            }
            if (step(&state, timed[k], moved, tau) > ARMGPI_STATUS_RUN) {
                faults += 1.0;
                (void)armgpi_init(&state, $init_now);
            }
            sink = tau[0];
        }
        steps += (double)rows;
        spent = (double)(clock() - begun) / (double)CLOCKS_PER_SEC;
    }
    return (faults < 0.1 * steps) ? (1e9 * spent / steps) : -1.0;
}

int main(int argc, char **argv)
{
    const char *const path = (argc > 1) ? argv[1] : "log.armlog";
    FILE *const file = fopen(path, "rb");
    static armgpi_log_row_t row;
    armgpi_real_t in[ARMGPI_INPUTS][ARMGPI_N];
    armgpi_real_t applied[ARMGPI_N];
    armgpi_real_t tau[ARMGPI_N];
    static armgpi_state_t state;
    armgpi_status_t status = ARMGPI_STATUS_INIT;
    double largest = 0.0;
    uint32_t samples = 0U;
    uint64_t first_fault = UINT64_MAX;

    if ((file == NULL) || (find_rows(file) == 0)) {
        (void)fprintf(stderr, "%s: no log that can be read\n", path);
        return 2;
    }
    while (fread(&row, sizeof row, 1U, file) == 1U) {
        uint32_t said = 1U; /* whether the robot reports what it applies */
        uint32_t i;
        uint32_t j;

        for (j = 0U; j < ARMGPI_N; ++j) {
            for (i = 0U; i < ARMGPI_INPUTS; ++i) {
                in[i][j] = (armgpi_real_t)row.in[i][j];
                if (samples < TIMED) {
                    timed[samples][i][j] = in[i][j];
                }
            }
            applied[j] = (armgpi_real_t)row.applied[j];
            said = (applied[j] <= LARGEST) ? said : 0U;
        }
        if (row.event == ARMGPI_LOG_INIT) {
            (void)armgpi_init(&state, $init_in);
        } else if (row.event == ARMGPI_LOG_RESET) {
            (void)armgpi_reset(&state, $init_in);
        } else {
            status = armgpi_step_late(&state, row.elapsed, $init_in, tau);
            if (said != 0U) {
                armgpi_within_rate(&state, applied, tau);
            }
            if (status > ARMGPI_STATUS_RUN) {
                first_fault = (first_fault < row.number) ? first_fault : row.number;
            }
            for (j = 0U; j < ARMGPI_N; ++j) {
                const double apart = (double)tau[j] - row.tau[j];
                const double share = ((apart < 0.0) ? -apart : apart) / SCALE[j];

                largest = (share > largest) ? share : largest;
            }
            ++samples;
        }
    }
    (void)fclose(file);
    if (samples == 0U) {
        (void)fprintf(stderr, "%s: no samples\n", path);
        return 2;
    }
    (void)printf("samples %lu\n", (unsigned long)samples);
    (void)printf("largest difference %.3g of the torque scale\n", largest);
    if (status > ARMGPI_STATUS_RUN) {
        const int tool = (state.reason >= ARMGPI_REASON_WORKSPACE) && (state.reason <= ARMGPI_REASON_TOOL_FORCE);

        (void)printf("fault %lu of %s%s at sample %lu\n", (unsigned long)state.reason, (tool != 0) ? "the tool" : "joint ",
            (tool != 0) ? "" : armgpi_info.joints[state.fault_joint], (unsigned long)first_fault);
    } else if (TIMING_SECONDS > 0.0) {
        const uint32_t rows = (samples < TIMED) ? samples : TIMED;

        (void)printf("step %.0f ns\n", time_steps(rows, $zero));
        (void)printf("step with torque saturated %.0f ns\n", time_steps(rows, $far));
    } else {
        /* Nothing is timed. */
    }
    (void)printf("state %lu bytes\n", (unsigned long)sizeof state);
    return ((status <= ARMGPI_STATUS_RUN) && ((TOLERANCE <= 0.0) || (largest <= TOLERANCE))) ? 0 : 1;
}
