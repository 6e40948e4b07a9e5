/*
 * Replay of a log: gives the controller what it was given in a simulation by armgpi and compares its torque
 * with that of the same controller in Python. For the host: it uses stdio.h and time.h, the controller does not.
 *
 *   replay [LOG]      log.csv by default
 *
 * Exit code 0 when the torques agree, 1 when they do not or the controller met a fault, 2 without a log.
 */
#include <float.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "armgpi_controller.h"

/* Numbers in a row of the log: arguments of a step, then torques from Python. */
#define ARGUMENTS (${count}U)
#define COLUMNS ((ARGUMENTS + 1U) * ARMGPI_N)
#define LINE_BYTES (32U * COLUMNS + 2U)
/* Rows that are timed. */
#define TIMED 2000U
/* Largest difference allowed, as a share of the torque scale; 0 when there is none to be kept. */
#define TOLERANCE $tolerance
/* How long to time [s]. */
#define TIMING_SECONDS $seconds

/* What a difference is a share of: the torque limit, or the largest torque in the log where there is none. */
static const double SCALE[ARMGPI_N] = {
$scale
};

static armgpi_real_t timed[TIMED][ARGUMENTS][ARMGPI_N];
static armgpi_real_t moved[ARMGPI_N];
static volatile armgpi_real_t sink;

/* Read a row of numbers; return 1 when there was one. */
static int read_row(FILE *file, double row[COLUMNS])
{
    static char line[LINE_BYTES];
    char *at = line;
    int read = 0;
    uint32_t i = 0U;

    if (fgets(line, (int)sizeof line, file) != NULL) {
        read = 1;
        while ((i < COLUMNS) && (read != 0)) {
            char *end = NULL;

            row[i] = strtod(at, &end);
            read = (end != at) ? 1 : 0;
            at = (*end == ',') ? (end + 1) : end;
            ++i;
        }
    }
    return read;
}

static armgpi_status_t step(armgpi_state_t *state, armgpi_real_t in[ARGUMENTS][ARMGPI_N],
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
    const char *const path = (argc > 1) ? argv[1] : "log.csv";
    FILE *const file = fopen(path, "r");
    static double row[COLUMNS];
    armgpi_real_t in[ARGUMENTS][ARMGPI_N];
    armgpi_real_t tau[ARMGPI_N];
    static armgpi_state_t state;
    armgpi_status_t status = ARMGPI_STATUS_INIT;
    double largest = 0.0;
    uint32_t samples = 0U;
    uint32_t first_fault = UINT32_MAX;
    int c = 0;

    if (file == NULL) {
        (void)fprintf(stderr, "%s: cannot be read\n", path);
        return 2;
    }
    while ((c != (int)'\n') && (c != EOF)) { /* the names of the columns */
        c = fgetc(file);
    }
    while (read_row(file, row) != 0) {
        uint32_t i;
        uint32_t j;

        for (i = 0U; i < ARGUMENTS; ++i) {
            for (j = 0U; j < ARMGPI_N; ++j) {
                in[i][j] = (armgpi_real_t)row[i * ARMGPI_N + j];
                if (samples < TIMED) {
                    timed[samples][i][j] = in[i][j];
                }
            }
        }
        if (samples == 0U) {
            (void)armgpi_init(&state, $init_in);
        }
        status = step(&state, in, in[$q_ref], tau);
        if (status > ARMGPI_STATUS_RUN) {
            first_fault = (first_fault < samples) ? first_fault : samples;
        }
        for (j = 0U; j < ARMGPI_N; ++j) {
            const double apart = (double)tau[j] - row[ARGUMENTS * ARMGPI_N + j];
            const double share = ((apart < 0.0) ? -apart : apart) / SCALE[j];

            largest = (share > largest) ? share : largest;
        }
        ++samples;
    }
    (void)fclose(file);
    if (samples == 0U) {
        (void)fprintf(stderr, "%s: no samples\n", path);
        return 2;
    }
    (void)printf("samples %lu\n", (unsigned long)samples);
    (void)printf("largest difference %.3g of the torque scale\n", largest);
    if (status > ARMGPI_STATUS_RUN) {
        (void)printf("fault %lu of joint %s at sample %lu\n", (unsigned long)state.reason,
            armgpi_info.joints[state.fault_joint], (unsigned long)first_fault);
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
