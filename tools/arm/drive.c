/* The same inputs on every machine; prints torques as bits, and on the target the instructions of each step. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include "armgpi_controller.h"
#define STEPS 1500
static uint32_t seed = 1U;
static double random_unit(void)
{
    seed = 1664525U * seed + 1013904223U;
    return (double)(seed >> 8) / 16777216.0 - 0.5;
}
static const double MIDDLE[ARMGPI_N] = {MIDDLES};
static armgpi_state_t state;
#ifdef TARGET
#define SYSTICK ((volatile uint32_t *)0xE000E010U)
static uint32_t now(void) { return SYSTICK[2]; }
#endif
int main(void)
{
    armgpi_real_t q[ARMGPI_N], r[ARMGPI_N], v[ARMGPI_N], a[ARMGPI_N], tau[ARMGPI_N];
    double at[ARMGPI_N], to[ARMGPI_N];
    uint32_t k, i;
#ifdef TARGET
    SYSTICK[1] = 0xFFFFFFU;
    SYSTICK[2] = 0U;
    SYSTICK[0] = 5U;
#endif
    for (i = 0U; i < ARMGPI_N; ++i) {
        at[i] = to[i] = MIDDLE[i];
        q[i] = r[i] = (armgpi_real_t)at[i];
        v[i] = a[i] = (armgpi_real_t)0;
    }
    (void)armgpi_init(&state, GIVEN);
    for (k = 0U; k < STEPS; ++k) {
        uint32_t ticks = 0U;
        armgpi_status_t status;

        for (i = 0U; i < ARMGPI_N; ++i) {
            at[i] += 2e-4 * random_unit();
            to[i] += 1e-4 * random_unit();
            v[i] = (armgpi_real_t)(0.1 * random_unit());
            a[i] = (armgpi_real_t)random_unit();
            q[i] = (armgpi_real_t)at[i];
            /* In every third stretch torque is at its limits. */
            r[i] = (armgpi_real_t)(to[i] + (((k / 100U) % 3U == 1U) ? 0.3 : 0.0));
        }
        if (k % 100U == 0U) { /* from anywhere that may be, far from zero too */
            for (i = 0U; i < ARMGPI_N; ++i) {
                at[i] = to[i] = MIDDLE[i] + SPREAD * random_unit();
                q[i] = (armgpi_real_t)at[i];
                r[i] = (armgpi_real_t)(to[i] + (((k / 100U) % 3U == 1U) ? 0.3 : 0.0));
            }
            (void)armgpi_init(&state, GIVEN);
        }
        if (k % 100U == 90U) { /* a measurement is missing */
            q[0] = (armgpi_real_t)0;
            q[0] /= q[0];
        }
#ifdef TARGET
        ticks = now();
#endif
        status = armgpi_step(&state, GIVEN, tau);
#ifdef TARGET
        ticks = (ticks - now()) & 0xFFFFFFU;
#endif
        (void)printf("%lu %lu", (unsigned long)status, (unsigned long)ticks);
        for (i = 0U; i < ARMGPI_N; ++i) {
            uint64_t bits = 0U;
            (void)memcpy(&bits, &tau[i], sizeof tau[i]);
            (void)printf(" %08lx%08lx", (unsigned long)(bits >> 32), (unsigned long)(bits & 0xFFFFFFFFU));
        }
        (void)printf("\n");
    }
    (void)v; /* of a law that takes no rates */
    (void)a;
    return 0;
}
