/* A step from any state and with any arguments within RANGE, for Frama-C's EVA: what may happen, and where. */
#include <stdint.h>
#include "armgpi_controller.c"
/*@ assigns \result \from \nothing; ensures \is_finite(\result) && -RANGE <= \result <= RANGE; */
double any_real(void);
static armgpi_state_t state;
int main(void)
{
    armgpi_real_t q[ARMGPI_N], r[ARMGPI_N], tau[ARMGPI_N];
    armgpi_real_t *numbers = &state.supervisor_status[0];
    uint32_t i;

    for (i = 0U; i < NUMBERS; ++i) {
        numbers[i] = any_real();
    }
    for (i = 0U; i < ARMGPI_N; ++i) {
        q[i] = any_real();
        r[i] = any_real();
    }
    state.layout = ARMGPI_LAYOUT;
    (void)armgpi_step(&state, q, r, tau);
    for (i = 0U; i < ARMGPI_N; ++i) {
        /*@ assert torque: \is_finite(tau[i]) && -EFFORT[i] <= tau[i] <= EFFORT[i]; */
    }
    return 0;
}
