
/*
 * Change the force limit while it runs: between two steps, in the thread of the steps. It goes there with a time constant of
 * 0.1 s, so the torque does not step; a far larger one grows e times in 0.1 s. The moment's limit changes in proportion.
 * Returns 1; 0 for what is refused, which changes nothing. init and reset go back to what was exported.
 *   limit   above 0, and not below armgpi_least_force_limit, the weight that the payload is uncertain by [N]
 */
#define ARMGPI_FORCE_LIMIT (1U)
extern const armgpi_real_t armgpi_least_force_limit;
uint32_t armgpi_force_limit(armgpi_state_t *state, armgpi_real_t limit);
