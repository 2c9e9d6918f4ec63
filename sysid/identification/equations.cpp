#include "sysid/identification/equations.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <Eigen/QR>
#include <fmt/format.h>

#include "sysid/identification/filtered_log.hpp"

namespace multipanda {
namespace {

constexpr double kCoulombVelocity = 0.05;  // [rad/s]
constexpr double kStribeckRise = 0.01;     // [rad/s]
constexpr double kStribeckVelocity = 0.3;  // [rad/s]
// The state at the start of a log is unknown. A moving joint has probably moved in the same direction before;
// a resting one may have come from either side.
constexpr double kMoving = 0.02;      // [rad/s]
constexpr double kComeFrom = 0.2;     // [rad]
constexpr double kForgotten = 0.003;  // the unknown start of a resting joint [rad]

double stribeck(double dq) {
  const double x = dq / kStribeckVelocity;
  return std::tanh(dq / kStribeckRise) * std::exp(-x * x);
}

// z <- s sign(dq) + (z - s sign(dq)) exp(-|dq| dt / s), exact while dq is constant; returned as z / s.
Eigen::MatrixXd presliding(double s, const Eigen::MatrixXd& dq, double dt) {
  Eigen::MatrixXd out(dq.rows(), dq.cols());
  for (Eigen::Index j = 0; j < dq.cols(); ++j) {
    const double first = dq.rows() > 0 ? dq(0, j) : 0.0;
    double z =
        std::abs(first) > kMoving ? std::copysign(1 - std::exp(-kComeFrom / s), first) : 0.0;  // over s
    for (Eigen::Index i = 0; i < dq.rows(); ++i) {
      const double v = dq(i, j), end = v > 0 ? 1.0 : v < 0 ? -1.0 : 0.0;
      z = end + (z - end) * std::exp(-std::abs(v) * dt / s);
      out(i, j) = z;
    }
  }
  return out;
}

// exp(-path / s): Dahl's law is linear in its start, and forgets it over the path.
Eigen::MatrixXd initial(double s, const Eigen::MatrixXd& dq, double dt) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(dq.rows(), dq.cols());
  for (Eigen::Index j = 0; j < dq.cols(); ++j) {
    double left = dq.rows() > 0 && std::abs(dq(0, j)) <= kMoving ? 1 : 0;
    for (Eigen::Index i = 0; i < dq.rows(); ++i) {
      out(i, j) = left *= std::exp(-std::abs(dq(i, j)) * dt / s);
    }
  }
  return out;
}

double sigmoid(double p2, double p3, double dq) {
  return 1 / (1 + std::exp(-p2 * (dq + p3))) - 1 / (1 + std::exp(-p2 * p3));
}

using Eigen::Index;

// R of the rows, or the rows themselves if there are fewer than columns.
Eigen::MatrixXd compressed(Eigen::MatrixXd A) {
  if (A.rows() <= A.cols()) return A;
  const Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(A);
  return A.topRows(A.cols()).template triangularView<Eigen::Upper>();
}

// Leaves the amplitude a of one more column c open: |A' x|^2 is the least |A x + c a|^2 + a^2 over a.
void leave_open(const Eigen::VectorXd& c, Eigen::MatrixXd& A) {
  const double n = c.squaredNorm();
  A -= c * (c.transpose() * A) / (1 + n + std::sqrt(1 + n));
}

void append(JointEquations& to, const Eigen::MatrixXd& A, Index rows) {
  Eigen::MatrixXd both(to.R.rows() + A.rows(), A.cols());
  both << to.R, A;
  to.R = compressed(std::move(both));
  to.rows += rows;
}

}  // namespace

std::string to_string(const FrictionPart& part) {
  switch (part.kind) {
    case FrictionKind::offset:
      return "offset";
    case FrictionKind::viscous:
      return "viscous";
    case FrictionKind::stribeck:
      return "stribeck";
    case FrictionKind::coulomb:
      return "coulomb";
    case FrictionKind::sigmoid:
      return "sigmoid";
    case FrictionKind::presliding:
      return fmt::format("presliding {:g} mrad", 1e3 * part.distance);
    case FrictionKind::initial:
      return fmt::format("initial {:g} mrad", 1e3 * part.distance);
    case FrictionKind::acceleration:
      return "joint inertia";
  }
  return {};
}

std::string unit_of(const FrictionPart& part) {
  if (part.kind == FrictionKind::viscous) return "N m s/rad";
  return part.kind == FrictionKind::acceleration ? "kg m^2" : "N m";
}

bool has_sign(const FrictionPart& part) { return part.kind != FrictionKind::offset; }

Eigen::MatrixXd friction_column(const FrictionPart& part, const Eigen::MatrixXd& dq,
                                const Eigen::MatrixXd& ddq, const std::optional<JointFriction>& table,
                                double dt) {
  switch (part.kind) {
    case FrictionKind::offset:
      return Eigen::MatrixXd::Ones(dq.rows(), dq.cols());
    case FrictionKind::viscous:
      return dq;
    case FrictionKind::stribeck:
      return dq.unaryExpr(&stribeck);
    case FrictionKind::coulomb:
      return (dq / kCoulombVelocity).array().tanh();
    case FrictionKind::presliding:
      return presliding(part.distance, dq, dt);
    case FrictionKind::initial:
      return initial(part.distance, dq, dt);
    case FrictionKind::acceleration:
      return ddq;
    case FrictionKind::sigmoid:
      break;
  }
  if (!table)
    throw std::invalid_argument("friction with the shape of the table: the robot has no friction table");
  Eigen::MatrixXd out(dq.rows(), dq.cols());
  for (Eigen::Index j = 0; j < dq.cols(); ++j) {
    out.col(j) = dq.col(j).unaryExpr([&](double v) { return sigmoid(table->p2[j], table->p3[j], v); });
  }
  return out;
}

Eigen::MatrixXd friction_torque(const JointFriction& table, const Eigen::MatrixXd& dq) {
  Eigen::MatrixXd out = friction_column({FrictionKind::sigmoid}, dq, dq, table, kCoulombVelocity);
  for (Eigen::Index j = 0; j < dq.cols(); ++j) out.col(j) *= table.p1[j];
  return out;
}

Eigen::MatrixXd friction_torque(const FrictionLaw& law, const Eigen::MatrixXd& dq, double dt) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(dq.rows(), dq.cols());
  const auto add = [&](const FrictionPart& part, const JointVector& amplitude) {
    if (amplitude.size() == 0) return;
    out += friction_column(part, dq, dq, {}, dt) * amplitude.asDiagonal();
  };
  add({FrictionKind::offset}, law.offset);
  add({FrictionKind::viscous}, law.viscous);
  add({FrictionKind::stribeck}, law.stribeck);
  for (const PreslidingElement& e : law.presliding) add({FrictionKind::presliding, e.distance}, e.amplitude);
  if (law.sigmoid) out += friction_torque(*law.sigmoid, dq);
  return out;
}

std::vector<Eigen::MatrixXd> kept_friction(const FilteredLog& log, const std::vector<FrictionPart>& parts,
                                           const std::optional<JointFriction>& table) {
  std::vector<Eigen::MatrixXd> out;
  for (const FrictionPart& part : parts) {
    const Eigen::MatrixXd column = friction_column(part, log.dq, log.ddq, table, kProtocolStep);
    // A constant passes the filter unchanged, and accelerations already passed a narrower one.
    const bool as_is = part.kind == FrictionKind::offset || part.kind == FrictionKind::acceleration;
    out.push_back(log.kept_rows(as_is ? column : protocol_filter(column)));
  }
  return out;
}

std::vector<Eigen::MatrixXd> restarted_friction(const FilteredLog& log, Index begin, Index end,
                                                const std::vector<FrictionPart>& parts,
                                                const std::optional<JointFriction>& table) {
  constexpr Index kBefore = 200;  // samples that the protocol drops at both ends of a file
  FilteredLog alone;
  if (begin < end) {
    const Index first = std::max<Index>(0, log.kept[static_cast<std::size_t>(begin)] - kBefore);
    const Index last = std::min(log.t.size(), log.kept[static_cast<std::size_t>(end - 1)] + kBefore);
    alone.t = log.t.segment(first, last - first);
    alone.dq = log.dq.middleRows(first, last - first);
    alone.ddq = log.ddq.middleRows(first, last - first);
    for (Index i = begin; i < end; ++i) alone.kept.push_back(log.kept[static_cast<std::size_t>(i)] - first);
  } else {
    alone.dq.resize(0, log.dq.cols());
    alone.ddq = alone.dq;
  }
  return kept_friction(alone, parts, table);
}

std::vector<Equations> equations_of(std::span<const FilteredLog> logs, const EquationSource& source,
                                    std::size_t blocks, bool restart) {
  ArmRegressor regressor(*source.robot);
  const Index n = regressor.joints(), parts = static_cast<Index>(source.parts.size());
  const bool open = std::ranges::any_of(
      source.parts, [](const FrictionPart& part) { return part.kind == FrictionKind::presliding; });
  std::vector<FrictionPart> columns = source.parts;
  if (open) columns.push_back({FrictionKind::initial, kForgotten});
  std::vector<Equations> out(blocks, Equations(static_cast<std::size_t>(n)));
  for (Equations& block : out) {
    for (Index j = 0; j < n; ++j) {
      block[static_cast<std::size_t>(j)].R.resize(0, 30 * (n - j) + parts + 1);
    }
  }
  for (const FilteredLog& log : logs) {
    const Vector3 gravity_B = log.gravity_B.value_or(source.gravity_B);
    const Eigen::Matrix<double, 3, 2> directions = tilt_directions(gravity_B);
    std::vector<Eigen::MatrixXd> friction;  // of the rows from `origin` on
    if (!restart) friction = kept_friction(log, columns, source.robot->friction);
    for (const auto& [b, begin, end] : block_ranges(log, blocks)) {
      const Index origin = restart ? begin : 0;
      if (restart) friction = restarted_friction(log, begin, end, columns, source.robot->friction);
      constexpr Index kAtOnce = 1000;  // rows held uncompressed
      for (Index from = begin; from < end; from += kAtOnce) {
        const Index rows = std::min(kAtOnce, end - from);
        std::vector<Eigen::MatrixXd> A;
        for (Index j = 0; j < n; ++j) A.emplace_back(rows, 30 * (n - j) + parts + 1);
        for (Index i = 0; i < rows; ++i) {
          const Index at = log.kept[static_cast<std::size_t>(from + i)];
          const Eigen::VectorXd q = log.q.row(at), dq = log.dq.row(at), ddq = log.ddq.row(at);
          for (int what = 0; what < 3; ++what) {
            const Eigen::MatrixXd& Y = what == 0 ? regressor.at(q, dq, ddq, gravity_B)
                                                 : regressor.of_field(q, directions.col(what - 1));
            for (Index j = 0; j < n; ++j) {
              const Index width = 10 * (n - j);
              A[static_cast<std::size_t>(j)].row(i).segment(what * width, width) = Y.row(j).tail(width);
            }
          }
          for (Index j = 0; j < n; ++j) {
            auto row = A[static_cast<std::size_t>(j)].row(i);
            for (Index p = 0; p < parts; ++p) {
              row[30 * (n - j) + p] = friction[static_cast<std::size_t>(p)](from + i - origin, j);
            }
            row[row.size() - 1] = log.tau(at, j);
          }
        }
        for (std::size_t j = 0; j < A.size(); ++j) {
          if (open) leave_open(friction.back().col(static_cast<Index>(j)).segment(from - origin, rows), A[j]);
          append(out[b][j], A[j], rows);
        }
      }
    }
  }
  return out;
}

Equations stacked(std::span<const Equations> parts, const std::function<bool(std::size_t)>& requested) {
  Equations out(parts.front().size());
  for (std::size_t j = 0; j < out.size(); ++j) {
    Index rows = 0;
    for (std::size_t b = 0; b < parts.size(); ++b) rows += requested(b) ? parts[b][j].R.rows() : 0;
    Eigen::MatrixXd all(rows, parts.front()[j].R.cols());
    rows = 0;
    for (std::size_t b = 0; b < parts.size(); ++b) {
      if (!requested(b)) continue;
      all.middleRows(rows, parts[b][j].R.rows()) = parts[b][j].R;
      rows += parts[b][j].R.rows();
      out[j].rows += parts[b][j].rows;
    }
    out[j].R = compressed(std::move(all));
  }
  return out;
}

}  // namespace multipanda
