// The model library that a program requests up to protocol version 9: 30 functions in plain C, loaded by
// libfranka on the program's computer. Its interface is given by that library's symbol names and arguments.
// It is compiled without the standard library, so that it runs on any Linux of this processor.
//
// Matrices at the interface are column-major. Frames: joints 1 to 7 (the link's frame), 8 the flange, 9 the
// end effector. All quantities refer to the arm's base; inertia of hand and load comes as an argument.
#include <cmath>

#include "fci/model/arm_numbers.hpp"

namespace multipanda::fci {
namespace {

constexpr int kJoints = ArmNumbers::kJoints;

__attribute__((used, section(".data")))
ArmNumbers patched_numbers = {{kMarker[0], kMarker[1], kMarker[2], kMarker[3]}, {}, {}, {}};

// The compiler must not assume the zeros above, which are overwritten in the file.
const ArmNumbers& numbers() {
  const ArmNumbers* p = &patched_numbers;
  asm volatile("" : "+r"(p));
  return *p;
}

struct Vector {
  double x = 0, y = 0, z = 0;
};
Vector operator+(Vector a, Vector b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vector operator-(Vector a, Vector b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vector operator*(double s, Vector a) { return {s * a.x, s * a.y, s * a.z}; }
Vector cross(Vector a, Vector b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vector vector_of(const double* p) { return {p[0], p[1], p[2]}; }

struct Matrix {
  Vector row[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
};
Vector operator*(const Matrix& m, Vector v) { return {dot(m.row[0], v), dot(m.row[1], v), dot(m.row[2], v)}; }
Matrix transposed(const Matrix& m) {
  return {{{m.row[0].x, m.row[1].x, m.row[2].x},
           {m.row[0].y, m.row[1].y, m.row[2].y},
           {m.row[0].z, m.row[1].z, m.row[2].z}}};
}
Matrix operator*(const Matrix& a, const Matrix& b) {
  const Matrix columns = transposed(b);
  Matrix product;
  for (int i = 0; i < 3; ++i)
    product.row[i] = {dot(a.row[i], columns.row[0]), dot(a.row[i], columns.row[1]),
                      dot(a.row[i], columns.row[2])};
  return product;
}
Matrix operator-(const Matrix& a, const Matrix& b) {
  return {{a.row[0] - b.row[0], a.row[1] - b.row[1], a.row[2] - b.row[2]}};
}
// The inertia of a point of this mass at d.
Matrix about(double mass, Vector d) {
  const double s = dot(d, d);
  return {{mass * (Vector{s, 0, 0} - d.x * d), mass * (Vector{0, s, 0} - d.y * d),
           mass * (Vector{0, 0, s} - d.z * d)}};
}
Matrix from_rows(const double* p) { return {{vector_of(p), vector_of(p + 3), vector_of(p + 6)}}; }
Matrix from_columns(const double* p) { return transposed(from_rows(p)); }

struct Placement {
  Matrix rotation;
  Vector position;
};
Placement operator*(const Placement& a, const Placement& b) {
  return {a.rotation * b.rotation, a.rotation * b.position + a.position};
}

Placement joint_placement(int i, double q) {
  const LinkNumbers& link = numbers().links[i];
  const double s = std::sin(q), c = std::cos(q);
  const Matrix turn{{{c, -s, 0}, {s, c, 0}, {0, 0, 1}}};
  return {from_rows(link.rotation) * turn, vector_of(link.position)};
}
Placement flange_placement() {
  return {from_rows(numbers().flange_rotation), vector_of(numbers().flange_position)};
}
Placement from_interface(const double* column_major) {
  return {{{{column_major[0], column_major[4], column_major[8]},
            {column_major[1], column_major[5], column_major[9]},
            {column_major[2], column_major[6], column_major[10]}}},
          vector_of(column_major + 12)};
}

// `frame`: 1 to 9. Stores the poses of all joints before it in `joints`, if requested.
Placement place(int frame, const double* q, const double* F_T_EE, Placement* joints = nullptr) {
  Placement X;
  for (int i = 0; i < kJoints && i < frame; ++i) {
    X = X * joint_placement(i, q[i]);
    if (joints) joints[i] = X;
  }
  if (frame >= 8) X = X * flange_placement();
  if (frame == 9) X = X * from_interface(F_T_EE);
  return X;
}

void pose(int frame, const double* q, const double* F_T_EE, double* out) {
  const Placement X = place(frame, q, F_T_EE);
  for (int column = 0; column < 3; ++column) {
    const Vector unit{column == 0 ? 1.0 : 0, column == 1 ? 1.0 : 0, column == 2 ? 1.0 : 0};
    const Vector v = X.rotation * unit;
    out[4 * column] = v.x, out[4 * column + 1] = v.y, out[4 * column + 2] = v.z, out[4 * column + 3] = 0;
  }
  out[12] = X.position.x, out[13] = X.position.y, out[14] = X.position.z, out[15] = 1;
}

// 6x7: linear velocity of the frame's origin, then angular velocity, in axes of the base, or of the frame.
void jacobian(int frame, const double* q, const double* F_T_EE, bool in_frame, double* out) {
  Placement joints[kJoints];
  const Placement X = place(frame, q, F_T_EE, joints);
  const Matrix axes = in_frame ? transposed(X.rotation) : Matrix{};
  for (int i = 0; i < kJoints; ++i) {
    Vector linear, angular;
    if (i < frame) {
      const Vector axis = joints[i].rotation * Vector{0, 0, 1};
      linear = axes * cross(axis, X.position - joints[i].position);
      angular = axes * axis;
    }
    double* column = out + 6 * i;
    column[0] = linear.x, column[1] = linear.y, column[2] = linear.z;
    column[3] = angular.x, column[4] = angular.y, column[5] = angular.z;
  }
}

// The load on the flange, in the flange's axes.
struct Carried {
  double mass;
  Vector com;
  Matrix inertia;  // about com
};

// Newton-Euler recursion, out along the chain and back: torques for the given motion, with the base
// accelerating against gravity [N m]. Every link's quantities are in its own axes.
void inverse_dynamics(const double* q, const double* dq, const double* ddq, Vector gravity,
                      const Carried& carried, double* tau) {
  Placement X[kJoints];
  Vector force[kJoints], torque[kJoints];  // that the link needs, about its origin
  Vector w, dw, a = -1.0 * gravity;        // of the link's origin
  for (int i = 0; i < kJoints; ++i) {
    X[i] = joint_placement(i, q[i]);
    const Matrix into = transposed(X[i].rotation);
    const Vector r = X[i].position;
    a = into * (a + cross(dw, r) + cross(w, cross(w, r)));
    w = into * w;
    const Vector spin{0, 0, dq ? dq[i] : 0};
    dw = into * dw + cross(w, spin) + Vector{0, 0, ddq ? ddq[i] : 0};
    w = w + spin;

    const auto add = [&](double mass, Vector com, const Matrix& inertia) {
      const Vector f = mass * (a + cross(dw, com) + cross(w, cross(w, com)));
      force[i] = force[i] + f;
      torque[i] = torque[i] + inertia * dw + cross(w, inertia * w) + cross(com, f);
    };
    const LinkNumbers& link = numbers().links[i];
    add(link.mass, vector_of(link.com), from_rows(link.inertia));
    if (i == kJoints - 1) {
      const Placement F = flange_placement();
      const Vector com = F.rotation * carried.com + F.position;
      Matrix inertia = F.rotation * carried.inertia * transposed(F.rotation);
      if (numbers().keeps_last_inertia != 0) {
        const double mass = link.mass + carried.mass;
        inertia = inertia - about(link.mass, (carried.mass / mass) * (com - vector_of(link.com)));
      }
      add(carried.mass, com, inertia);
    }
  }
  for (int i = kJoints - 1; i >= 0; --i) {
    tau[i] = torque[i].z;
    if (i == 0) break;
    const Vector f = X[i].rotation * force[i];
    force[i - 1] = force[i - 1] + f;
    torque[i - 1] = torque[i - 1] + X[i].rotation * torque[i] + cross(X[i].position, f);
  }
}

}  // namespace
}  // namespace multipanda::fci

using namespace multipanda::fci;

#define EXPORTED extern "C" __attribute__((visibility("default"))) void
#define FRAME(n)                                                                \
  EXPORTED O_T_J##n(const double* q, double* out) { pose(n, q, nullptr, out); } \
  static_assert(n <= 8)
#define JACOBIANS(n)                                                                       \
  EXPORTED Ji_J_J##n(const double* q, double* out) { jacobian(n, q, nullptr, true, out); } \
  EXPORTED O_J_J##n(const double* q, double* out) { jacobian(n, q, nullptr, false, out); } \
  static_assert(n <= 8)

FRAME(1);
FRAME(2);
FRAME(3);
FRAME(4);
FRAME(5);
FRAME(6);
FRAME(7);
FRAME(8);
JACOBIANS(2);
JACOBIANS(3);
JACOBIANS(4);
JACOBIANS(5);
JACOBIANS(6);
JACOBIANS(7);
JACOBIANS(8);

// The first joint's do not depend on q.
EXPORTED Ji_J_J1(double* out) {
  const double q[kJoints] = {};
  jacobian(1, q, nullptr, true, out);
}
EXPORTED O_J_J1(double* out) {
  const double q[kJoints] = {};
  jacobian(1, q, nullptr, false, out);
}
EXPORTED O_T_J9(const double* q, const double* F_T_EE, double* out) { pose(9, q, F_T_EE, out); }
EXPORTED Ji_J_J9(const double* q, const double* F_T_EE, double* out) { jacobian(9, q, F_T_EE, true, out); }
EXPORTED O_J_J9(const double* q, const double* F_T_EE, double* out) { jacobian(9, q, F_T_EE, false, out); }

EXPORTED M_NE(const double* q, const double* I_load, double m_load, const double* F_x_Cload, double* out) {
  const Carried carried{m_load, vector_of(F_x_Cload), from_columns(I_load)};
  double columns[kJoints][kJoints];
  for (int i = 0; i < kJoints; ++i) {
    double unit[kJoints] = {};
    unit[i] = 1;
    inverse_dynamics(q, nullptr, unit, {}, carried, columns[i]);
  }
  for (int i = 0; i < kJoints; ++i)
    for (int j = 0; j < kJoints; ++j) out[kJoints * i + j] = 0.5 * (columns[i][j] + columns[j][i]);
}

EXPORTED c_NE(const double* q, const double* dq, const double* I_load, double m_load, const double* F_x_Cload,
              double* out) {
  inverse_dynamics(q, dq, nullptr, {}, {m_load, vector_of(F_x_Cload), from_columns(I_load)}, out);
}

EXPORTED g_NE(const double* q, const double* g_earth, double m_load, const double* F_x_Cload, double* out) {
  // Inertia about the center of mass has no effect at rest.
  inverse_dynamics(q, nullptr, nullptr, vector_of(g_earth), {m_load, vector_of(F_x_Cload), Matrix{}}, out);
}
