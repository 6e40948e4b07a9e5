
/* Number of springs: $kind. */
#define ARMGPI_SPRINGS (${springs}U)
$limit_macro
/*
 * Change the springs while they act: between two steps, in the thread of the steps. They go there with a time constant of
 * 0.1 s, so the torque does not step. Return 1; 0 for what is refused, which changes nothing. init and reset go back to what was exported.
 *   stiffness   from 0 to armgpi_largest_stiffness [$unit]
$limit_note *   guided      ARMGPI_GUIDED: a hand guides the arm, the springs are gone and the wished position follows; ARMGPI_LEFT: it
 *               stays where it was left; ARMGPI_BACK: it goes back to its reference
 */
#define ARMGPI_LEFT   0U
#define ARMGPI_GUIDED 1U
#define ARMGPI_BACK   2U
extern const armgpi_real_t armgpi_largest_stiffness[ARMGPI_SPRINGS];
uint32_t armgpi_stiffness(armgpi_state_t *state, const armgpi_real_t stiffness[ARMGPI_SPRINGS]);
${limit_prototype}uint32_t armgpi_guide(armgpi_state_t *state, uint32_t guided);
