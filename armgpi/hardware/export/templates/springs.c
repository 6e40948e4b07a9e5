
/* ---- Changes of the springs ---- */

const armgpi_real_t armgpi_largest_stiffness[ARMGPI_SPRINGS] = {
$most
};

uint32_t armgpi_stiffness(armgpi_state_t *state, const armgpi_real_t stiffness[ARMGPI_SPRINGS])
{
    uint32_t good = (state->layout == ARMGPI_LAYOUT) ? 1U : 0U;
    uint32_t i;

    for (i = 0U; i < ARMGPI_SPRINGS; ++i) {
        if (!((stiffness[i] >= $zero) && (stiffness[i] <= armgpi_largest_stiffness[i]))) {
            good = 0U; /* NaN, too */
        }
    }
    for (i = 0U; (i < ARMGPI_SPRINGS) && (good != 0U); ++i) {
        state->${state}goal[i] = stiffness[i];
    }
    return good;
}
$limit_function
uint32_t armgpi_guide(armgpi_state_t *state, uint32_t guided)
{
    const uint32_t good = ((state->layout == ARMGPI_LAYOUT) && (guided <= ARMGPI_BACK)) ? 1U : 0U;

    if (good != 0U) {
        state->${state}guided[0] = (guided == ARMGPI_GUIDED) ? $one : $zero;
        state->${state}kept[0] = (guided == ARMGPI_BACK) ? $zero : $one;
    }
    return good;
}
