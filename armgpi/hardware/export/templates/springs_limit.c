
uint32_t armgpi_spring_limit(armgpi_state_t *state, const armgpi_real_t limit[ARMGPI_SPRING_LIMITS])
{
    uint32_t good = (state->layout == ARMGPI_LAYOUT) ? 1U : 0U;
    uint32_t i;

    for (i = 0U; i < ARMGPI_SPRING_LIMITS; ++i) {
        if (!((limit[i] > $zero) && (limit[i] <= REAL_MAX))) {
            good = 0U; /* NaN, too */
        }
    }
    for (i = 0U; (i < ARMGPI_SPRING_LIMITS) && (good != 0U); ++i) {
        state->${state}limit_goal[i] = limit[i];
    }
    return good;
}
