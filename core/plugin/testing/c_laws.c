/* A library of laws in plain C, for c_law_test.cpp. */
#include <math.h>
#include <stddef.h>

#include "core/plugin/c_law.h"

#ifndef VERSION
#define VERSION MULTIPANDA_C_LAW_VERSION
#endif

/* tau = J^T (f + k (p_d - p, 0)) + M dq + c + 2 g + 3 tau_J + 5 tau_ext_hat + d dq; counts its ticks. */
static int32_t start_mirror(const multipanda_c_tick* tick) {
  tick->memory[1] = tick->arms[0].q[0];
  return tick->arms[0].q[0] > 2 ? 1 : 0;
}
static int32_t mirror(const multipanda_c_tick* tick) {
  const multipanda_c_arm* arm = &tick->arms[0];
  double force[6];
  for (size_t k = 0; k < 6; ++k) force[k] = tick->inputs[1].value[k] + arm->F_K_W_est[k];
  for (size_t k = 0; k < 3; ++k)
    force[k] += tick->parameters[0][0] * (tick->inputs[0].value[k] - arm->p_WE[k]);
  for (size_t i = 0; i < arm->n; ++i) {
    arm->tau[i] += arm->c[i] + 2 * arm->g[i] + 3 * arm->tau_J[i] + 5 * arm->tau_ext_hat[i];
    arm->tau[i] += tick->parameters[1][i] * arm->dq[i];
    for (size_t j = 0; j < arm->n; ++j) arm->tau[i] += arm->M[i * arm->n + j] * arm->dq[j];
    for (size_t k = 0; k < 6; ++k) arm->tau[i] += arm->J_V_WE[k * arm->n + i] * force[k];
  }
  tick->memory[0] += 1;
  tick->outputs[0] = tick->memory[0];
  tick->outputs[1] = tick->memory[1];
  for (size_t k = 0; k < 9; ++k) tick->outputs[2 + k] = arm->R_WE[k] - 2 * tick->inputs[0].rotation[k];
  for (size_t k = 0; k < 6; ++k) tick->outputs[11 + k] = arm->V_WE[k] - 2 * tick->inputs[0].velocity[k];
  tick->outputs[17] = tick->inputs[2].value[0] + 2 * tick->inputs[2].velocity[0];
  tick->outputs[18] = tick->dt + tick->spring_force;
  return 0;
}

/* Parameter fault: 0 a damper, 1 not a number, 2 infinite, 3 a code. */
static int32_t faulty(const multipanda_c_tick* tick) {
  const double fault = tick->parameters[0][0];
  multipanda_c_arm* arm = &tick->arms[0];
  for (size_t i = 0; i < arm->n; ++i) arm->tau[i] = -2 * arm->dq[i];
  if (fault == 1) arm->tau[arm->n - 1] = NAN;
  if (fault == 2) arm->tau[0] = INFINITY;
  return fault == 3 ? 7 : 0;
}

/* Never returns while its parameter is 1. */
static int32_t endless(const multipanda_c_tick* tick) {
  static volatile int turns;
  while (tick->parameters[0][0] > 0) ++turns;
  return 0;
}

static const double kStiffness[] = {100};
static const double kDamping[] = {1};
static const double kNone[] = {0};
static const multipanda_c_parameter kMirrorParameters[] = {
    {"stiffness_n_per_m", "N/m", "Stiffness k.", 1, 1, kStiffness, 0, 1000},
    {"damping_nms_per_rad", "N m s/rad", "Damping d.", MULTIPANDA_PER_JOINT, 1, kDamping, 0, 5}};
static const multipanda_c_parameter kFaultyParameters[] = {{"fault", "", "Which.", 1, 1, kNone, 0, 3}};
static const multipanda_c_parameter kEndlessParameters[] = {{"hang", "", "Whether.", 1, 1, kNone, 0, 1}};
static const multipanda_c_input kMirrorInputs[] = {{"pose", "p_d.", MULTIPANDA_POSE, 0},
                                                   {"wrench", "f.", MULTIPANDA_WRENCH, 0},
                                                   {"height", "h.", MULTIPANDA_SCALAR, 0}};
static const multipanda_c_output kMirrorOutputs[] = {
    {"ticks", "Ticks.", 1}, {"q_start_rad", "At the start.", 1}, {"R", "Rotations.", 9}, {"V", "Twists.", 6}, {"rest", "", 2}};

enum { kAll = 2 * MULTIPANDA_USES_TAU_J - 1 };

static const multipanda_c_law kLaws[] = {
    {"c_mirror", "What it gets.", 1, kAll, 3, 2, 5, 2, kMirrorInputs, kMirrorParameters, kMirrorOutputs, start_mirror,
     mirror},
    {"c_faulty", "A damper with faults.", 1, 0, 0, 1, 0, 0, NULL, kFaultyParameters, NULL, NULL, faulty},
    {"c_endless", "Hangs.", 1, 0, 0, 1, 0, 0, NULL, kEndlessParameters, NULL, NULL, endless}};

static const multipanda_c_laws kAllLaws = {VERSION,
                                           sizeof(multipanda_c_law),
                                           sizeof(multipanda_c_parameter),
                                           sizeof(multipanda_c_input),
                                           sizeof(multipanda_c_output),
                                           sizeof(multipanda_c_arm),
                                           sizeof(multipanda_c_set_point),
                                           sizeof(multipanda_c_tick),
                                           3,
                                           0,
                                           kLaws};

__attribute__((visibility("default"))) const multipanda_c_laws* multipanda_laws(void) { return &kAllLaws; }
