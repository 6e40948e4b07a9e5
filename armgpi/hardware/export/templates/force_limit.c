
/* ---- Changes of the force limit ---- */

const armgpi_real_t armgpi_least_force_limit = $least;

uint32_t armgpi_force_limit(armgpi_state_t *state, armgpi_real_t limit)
{
    uint32_t good = 0U;

    if ((state->layout == ARMGPI_LAYOUT) && (limit > $zero) && (limit >= armgpi_least_force_limit) && (limit <= REAL_MAX)) {
        state->$goal[0] = limit; /* not NaN: it compares as none of these */
        good = 1U;
    }
    return good;
}
