#include "core/testing/test_arm.hpp"

#include <cstdio>
#include <numbers>

namespace multipanda::test {
namespace {

constexpr double kQuarter = std::numbers::pi / 2;

std::string text(const char* format, double a, double b, double c) {
  char buffer[160];
  std::snprintf(buffer, sizeof(buffer), format, a, b, c);
  return buffer;
}

// The angles of rotation_from_rpy.
Vector3 rpy_of(const Matrix3& R) {
  return {std::atan2(R(2, 1), R(2, 2)), std::asin(-R(2, 0)), std::atan2(R(1, 0), R(0, 0))};
}

std::string origin(const Pose& X) {
  const Vector3 rpy = rpy_of(X.rotation);
  return "<origin" + text(" xyz='%.17g %.17g %.17g'", X.position.x(), X.position.y(), X.position.z()) +
         text(" rpy='%.17g %.17g %.17g'/>", rpy.x(), rpy.y(), rpy.z());
}

// Inertia of three unequal masses, rotated: physically consistent by construction.
Matrix3 some_inertia(Draw& draw, double mass, double size) {
  Vector3 box;
  for (int i = 2; i >= 0; --i) box[i] = draw.uniform(0.3, 1) * size;
  const Vector3 squares = box.cwiseProduct(box);
  const Vector3 principal(squares.y() + squares.z(), squares.x() + squares.z(), squares.x() + squares.y());
  const Matrix3 R = draw.rotation();
  return mass / 12 * R * principal.asDiagonal() * R.transpose();
}

}  // namespace

Matrix3 Draw::rotation() {
  Quaternion q;
  for (double* value : {&q.z(), &q.y(), &q.x(), &q.w()}) *value = uniform(-1, 1);
  return q.norm() < 0.1 ? rotation() : q.normalized().toRotationMatrix();
}

JointVector Draw::joints(std::size_t n, double size) {
  JointVector q = joint_constant(n, 0);
  for (double& v : q) v = uniform(-size, size);
  return q;
}

Load Draw::load(double mass) {
  return {.mass = mass, .p_FC = vector3(0.1), .inertia_C = some_inertia(*this, mass, 0.2)};
}

TestArm TestArm::make(std::size_t joints, std::uint32_t seed) {
  Draw draw(seed);
  TestArm arm;
  for (std::size_t i = 0; i < joints; ++i) {
    TestLink link;
    // Neighboring axes are nearly perpendicular, with small random deviations.
    Vector3 rpy, place;
    for (int k = 2; k >= 0; --k) rpy[k] = draw.uniform(-0.2, 0.2);
    rpy[0] += i % 2 == 0 ? -kQuarter : kQuarter;
    place.z() = draw.uniform(0, 0.1);
    place.y() = draw.uniform(0.1, 0.25);
    place.x() = draw.uniform(-0.08, 0.08);
    link.X_PJ = {rotation_from_rpy(rpy), place};
    if (i == 0) link.X_PJ = {Matrix3::Identity(), Vector3(0, 0, 0.3)};
    link.axis = i == 3 ? Vector3(0.6, 0, 0.8) : Vector3(0, 0, i == 2 ? -1.0 : 1.0);
    link.mass = 4.0 - 3.0 * static_cast<double>(i) / static_cast<double>(joints);
    link.p_JC = draw.vector3(0.08);
    link.inertia_C = some_inertia(draw, link.mass, 0.25);
    arm.links.push_back(link);
  }
  arm.X_JF = {draw.rotation(), Vector3(0.02, -0.03, 0.12)};
  return arm;
}

std::string TestArm::urdf() const {
  std::string xml = "<robot name='test'><link name='base'/>";
  for (std::size_t i = 0; i < links.size(); ++i) {
    const TestLink& link = links[i];
    const std::string number = std::to_string(i);
    const Matrix3& I = link.inertia_C;
    xml += "<link name='link" + number + "'><inertial>" + origin({Matrix3::Identity(), link.p_JC}) +
           text("<mass value='%.17g'/>", link.mass, 0, 0) +
           text("<inertia ixx='%.17g' ixy='%.17g' ixz='%.17g'", I(0, 0), I(0, 1), I(0, 2)) +
           text(" iyy='%.17g' iyz='%.17g' izz='%.17g'/>", I(1, 1), I(1, 2), I(2, 2)) + "</inertial></link>";
    xml += "<joint name='joint" + number + "' type='revolute'><parent link='" +
           (i == 0 ? std::string("base") : "link" + std::to_string(i - 1)) + "'/><child link='link" + number +
           "'/>" + origin(link.X_PJ) +
           text("<axis xyz='%.17g %.17g %.17g'/>", link.axis.x(), link.axis.y(), link.axis.z()) +
           "<limit lower='-2.8' upper='2.8' velocity='2.5' effort='80'/></joint>";
  }
  xml += "<link name='flange'/><joint name='to_flange' type='fixed'><parent link='link" +
         std::to_string(links.size() - 1) + "'/><child link='flange'/>" + origin(X_JF) + "</joint></robot>";
  return xml;
}

ArmModelSource TestArm::source(const Pose& X_WB, const std::string& name) const {
  ArmModelSource source;
  source.name = name;
  source.urdf = urdf();
  source.flange = "flange";
  source.X_WB = X_WB;
  source.q_home = joint_constant(links.size(), 0);
  for (Eigen::Index i = 0; i < source.q_home.size(); ++i) source.q_home[i] = i % 2 == 0 ? 0.3 : -0.6;
  return source;
}

std::shared_ptr<const ArmModel> TestArm::model(const Pose& X_WB, const std::string& name) const {
  return std::make_shared<const ArmModel>(source(X_WB, name));
}

void add_collision_shapes(ArmModelSource& source, std::size_t joints, std::uint32_t seed) {
  Draw draw(seed);
  for (int joint = -1; joint < static_cast<int>(joints); ++joint) {
    const std::size_t count = 1 + draw.index(2);
    for (std::size_t k = 0; k < count; ++k) {
      CollisionShape part;
      part.name = "part" + std::to_string(source.collision_shapes.size());
      part.joint = joint;
      part.scene = joint > 0;
      part.X_JS = draw.pose(0.05);
      const double r = draw.uniform(0.03, 0.06);
      switch (draw.index(4)) {
        case 0:
          part.shape = ConvexShape::sphere(draw.vector3(0.05), r);
          break;
        case 1:
          part.shape = ConvexShape::box({r, 2 * r, 3 * r}, 0.01);
          break;
        default: {
          const Vector3 to = draw.vector3(0.1);
          part.shape = ConvexShape::capsule(draw.vector3(0.1), to, r);
        }
      }
      source.collision_shapes.push_back(part);
    }
  }
  const auto& parts = source.collision_shapes;
  for (std::size_t a = 0; a < parts.size(); ++a) {
    for (std::size_t b = a + 1; b < parts.size(); ++b) {
      if (parts[b].joint > parts[a].joint + 1) source.self_pairs.emplace_back(a, b);
    }
  }
}

}  // namespace multipanda::test
