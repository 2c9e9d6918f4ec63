#pragma once

/* Control laws behind a plain C interface, for laws that are written in another language than C++, such as those of
 * docs/python_laws.md. A library exports
 *
 *   const multipanda_c_laws* multipanda_laws(void);
 *
 * Version and sizes of the structures take the place of the headers' hash (core/plugin/plugin.hpp): the program refuses a library with other ones. Everything is plain data that stays valid for ever.
 *
 * Units are SI, frames and signs those of CONVENTIONS.md: W is the world, E the end effector, K the stiffness frame;
 * 6-vectors are linear first, in world axes; matrices are row-major. */

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MULTIPANDA_C_LAW_VERSION 1u
/* As the size of a parameter: one number per joint of the first arm. */
#define MULTIPANDA_PER_JOINT 0u

/* Quantity of an input: core/reference/target.hpp. */
enum {
  MULTIPANDA_POSE = 0,
  MULTIPANDA_TWIST = 1,
  MULTIPANDA_WRENCH = 2,
  MULTIPANDA_JOINTS = 3,
  MULTIPANDA_SCALAR = 4
};

/* What a law uses of each arm beyond n, q, dq and tau. Other pointers are null, so that nothing is computed in
 * vain. A law that uses an estimate which the arm does not have, does not start. */
enum {
  MULTIPANDA_USES_POSE = 1,           /* p_WE, R_WE */
  MULTIPANDA_USES_TWIST = 2,          /* V_WE */
  MULTIPANDA_USES_JACOBIAN = 4,       /* J_V_WE */
  MULTIPANDA_USES_MASS = 8,           /* M */
  MULTIPANDA_USES_CORIOLIS = 16,      /* c */
  MULTIPANDA_USES_GRAVITY = 32,       /* g */
  MULTIPANDA_USES_TAU_EXT = 64,       /* tau_ext_hat */
  MULTIPANDA_USES_WRENCH = 128,       /* F_K_W_est */
  MULTIPANDA_USES_TAU_J = 256         /* tau_J */
};

/* Texts are UTF-8 and end with 0. Names carry their unit: "stiffness_n_per_m". */
typedef struct {
  const char* name;
  const char* unit; /* "N/m"; "" for pure numbers */
  const char* doc;
  uint32_t size;            /* numbers, or MULTIPANDA_PER_JOINT */
  uint32_t initial_count;   /* `size` numbers, or 1 for all */
  const double* initial;
  double min, max; /* bounds of each number */
} multipanda_c_parameter;

typedef struct {
  const char* name;
  const char* doc;
  uint32_t quantity;
  uint32_t arm; /* index, among the law's arms, of the one that gives the start and the number of joints */
} multipanda_c_input;

typedef struct {
  const char* name;
  const char* doc;
  uint32_t size; /* numbers */
} multipanda_c_output;

/* An arm in one tick. Read-only, except for tau. */
typedef struct {
  uint64_t n;           /* joints */
  const double* q;      /* measured position (n) [rad] */
  const double* dq;     /* measured velocity (n) [rad/s] */
  const double* tau_J;  /* measured link-side torque, with gravity (n) [N m] */
  const double* p_WE;   /* position of E (3) [m] */
  const double* R_WE;   /* rotation of E (3 x 3) */
  const double* V_WE;   /* twist of E (6) [m/s, rad/s] */
  const double* J_V_WE; /* Jacobian, V_WE = J_V_WE dq (6 x n) */
  const double* M;      /* mass matrix (n x n) [kg m^2] */
  const double* c;      /* Coriolis torque C(q, dq) dq (n) [N m] */
  const double* g;      /* gravity torque that holds the arm still (n) [N m] */
  const double* tau_ext_hat; /* estimated external torque (n) [N m] */
  const double* F_K_W_est;   /* estimated wrench on the environment, about K (6) [N, N m] */
  double* tau; /* output (n) [N m]: torque without gravity and friction, zero at entry; a law adds c if it compensates
                  it */
} multipanda_c_arm;

/* The set-point of an input, continuous whatever arrives. Pointers that a quantity does not have are null. */
typedef struct {
  const double* value;    /* pose: position (3); joints (n); twist, wrench (6); scalar (1) */
  const double* rotation; /* pose: (3 x 3) */
  const double* velocity; /* pose: twist (6); joints (n); scalar (1) */
  const double* acceleration; /* pose (6); joints (n) */
} multipanda_c_set_point;

typedef struct {
  double dt;     /* since the last tick [s]; of the start: 0.001 */
  double time_s; /* the loop's time */
  /* Bounds for an arm beside a person (docs/contact.md), infinite if lifted. The set-points keep to hand_speed; a law must bound its own pull. */
  double hand_speed;    /* [m/s] */
  double spring_force;  /* [N] */
  double spring_moment; /* [N m] */
  multipanda_c_arm* arms;
  const multipanda_c_set_point* inputs;
  const double* const* parameters; /* each of its size */
  double* outputs;                 /* all, in order; zero at entry */
  double* memory;                  /* `memory_size` numbers of this instance, zero at the start */
} multipanda_c_tick;

/* 0: the torques are valid. Everything else is a fault: the program deactivates the law in the same cycle and holds its
 * arms, as it does for a torque that is not finite. Called by the 1 kHz loop: never allocate, lock, throw or do I/O. */
typedef int32_t (*multipanda_c_function)(const multipanda_c_tick*);

typedef struct {
  const char* type; /* the controllet's type in scene files: letters, digits and _ */
  const char* doc;
  uint32_t arms;
  uint32_t uses; /* sum of MULTIPANDA_USES_... */
  uint32_t input_count, parameter_count, output_count, memory_size;
  const multipanda_c_input* inputs;
  const multipanda_c_parameter* parameters;
  const multipanda_c_output* outputs;
  multipanda_c_function start;  /* before the first tick, without torques; may be null. A fault refuses the start */
  multipanda_c_function update; /* one tick */
} multipanda_c_law;

typedef struct {
  /* The version and the sizes come first in every version; the sizes are those of the structures here. */
  uint32_t version;
  uint32_t size_of_law, size_of_parameter, size_of_input, size_of_output, size_of_arm, size_of_set_point, size_of_tick;
  uint32_t law_count;
  uint32_t reserved; /* 0 */
  const multipanda_c_law* laws;
} multipanda_c_laws;

#ifdef __cplusplus
}
#endif
