// ~/markers through the wire: places compared with closed forms, on bases off the origin and turned.
#include "ros/adapter/state/markers.hpp"

#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/state/testing/state_fixture.hpp"

namespace multipanda::ros::markers_test {
namespace {

using test::StateFixture;
using visualization_msgs::msg::Marker;
using visualization_msgs::msg::MarkerArray;

Pose turned(const Vector3& p, double roll, double pitch, double yaw) {
  using Eigen::AngleAxisd;
  const Quaternion q = AngleAxisd(yaw, Vector3::UnitZ()) * AngleAxisd(pitch, Vector3::UnitY()) *
                       AngleAxisd(roll, Vector3::UnitX());
  return Pose::from(p, q);
}

const Pose kLeftBase = turned({0.1, 0.5, 0.2}, 0.4, -0.3, 1.1);
const Pose kRightBase = turned({-0.2, -0.7, 0.1}, -0.6, 0.2, -2.0);
const Pose kLeftK = turned({0.02, 0.01, 0.05}, 0.3, 0.2, -0.5);

// Hand's tool center point in the base, by the arm's Denavit-Hartenberg table (Craig's convention).
Pose hand_in_base(const double* q) {
  const double a[] = {0, 0, 0, 0.0825, -0.0825, 0, 0.088}, d[] = {0.333, 0, 0.316, 0, 0.384, 0, 0};
  const int quarters[] = {0, -1, 1, 1, -1, 1, 1};
  Pose X;
  for (std::size_t i = 0; i < 7; ++i) {
    X = X * turned({a[i], 0, 0}, quarters[i] * std::numbers::pi / 2, 0, 0) * turned({0, 0, d[i]}, 0, 0, q[i]);
  }
  return X * turned({0, 0, 0.107 + 0.1034}, 0, 0, -std::numbers::pi / 4);
}

// The right hand's target in its base: fingers down.
const Pose kTarget = kRightBase * turned({0.45, 0.1, 0.5}, std::numbers::pi, 0, 0.2);

std::string scene_text() {
  const Quaternion q = kTarget.quaternion();
  const Vector3& p = kTarget.position;
  return "arms:\n"
         "  - name: left\n"
         "    base: {position_m: [0.1, 0.5, 0.2], rpy_rad: [0.4, -0.3, 1.1]}\n"
         "    stiffness_frame: {position_m: [0.02, 0.01, 0.05], rpy_rad: [0.3, 0.2, -0.5]}\n"
         "  - {name: right, base: {position_m: [-0.2, -0.7, 0.1], rpy_rad: [-0.6, 0.2, -2.0]}}\n"
         "objects:\n"
         "  - {name: shelf, shape: box, size_m: [0.4, 0.3, 0.2], position_m: [2, 1, 0.5], rpy_rad: [0.3, "
         "-0.2, 0.9]}\n"
         "  - {name: rod, shape: capsule, diameter_m: 0.05, length_m: 0.3, position_m: [2.5, -1, 0.4], "
         "rpy_rad: [1.2, 0.4, -0.3]}\n"
         "  - {name: ball, shape: sphere, diameter_m: 0.1, position_m: [3, 0, 1], fixed: false, mass_kg: 1}\n"
         "controllets:\n"
         "  - {name: left_joint, type: joint_impedance, arms: left}\n"
         "  - {name: right_ufic, type: ufic, arms: right, parameters: {tank_start_j: 1.5}}\n"
         "  - {name: right_force, type: force, arms: right}\n"
         "active: [left_joint, right_ufic]\n" +
         fmt::format(
             "timeline:\n"
             "  - at_s: 0.01\n"
             "    reference: {{controllet: right_ufic, input: pose, position_m: [{}, {}, {}], "
             "quaternion_wxyz: [{}, {}, {}, {}], duration_s: 0.5}}\n"
             "  - {{at_s: 6, switch: {{activate: [right_force]}}}}\n",
             p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z());
}

std::int64_t ns(const Marker& marker) {
  return marker.header.stamp.sec * 1'000'000'000ll + marker.header.stamp.nanosec;
}
const Marker& find(const MarkerArray& message, const std::string& space, int id) {
  for (const auto& marker : message.markers) {
    if (marker.ns == space && marker.id == id) return marker;
  }
  throw std::out_of_range("no marker " + space + " " + std::to_string(id));
}
bool there(const MarkerArray& message, const std::string& space, int id) {
  return find(message, space, id).action == Marker::ADD;
}
Vector3 vector(const auto& v) { return {v.x, v.y, v.z}; }
void expect_pose(const Marker& marker, const Pose& X, double tolerance = 1e-9) {
  EXPECT_EQ(marker.header.frame_id, "world");
  EXPECT_EQ(marker.action, Marker::ADD);
  EXPECT_LT((vector(marker.pose.position) - X.position).norm(), tolerance) << marker.ns << marker.id;
  const auto& o = marker.pose.orientation;
  EXPECT_LT((Quaternion(o.w, o.x, o.y, o.z).toRotationMatrix() - X.rotation).norm(), tolerance)
      << marker.ns << marker.id;
}
void expect_arrow(const Marker& marker, const Vector3& from, const Vector3& force) {
  expect_pose(marker, Pose{});
  ASSERT_EQ(marker.points.size(), 2u);
  EXPECT_LT((vector(marker.points[0]) - from).norm(), 1e-9);
  EXPECT_LT((vector(marker.points[1]) - from - 0.005 * force).norm(), 1e-12);
}

// A scene whose records a test may change before they are published.
struct Shown : testing::Test {
  // Runs until a message of a record from now on has come.
  const MarkerArray& next() {
    const std::int64_t begin = newest_ns;
    const auto come = [&] {
      const std::lock_guard lock(received.mutex);
      return !received.messages.empty() && ns(received.messages.back().markers.at(0)) > begin;
    };
    EXPECT_TRUE(test::wait_for([&] {
      run(100);
      return come();
    }));
    const std::lock_guard lock(received.mutex);
    last = received.messages.back();
    return last;
  }
  void run(std::size_t cycles) {
    fixture.run(cycles, {}, [&](const CycleRecord& record) {
      CycleRecord copy = record;
      if (edit) edit(copy);
      Tick tick;
      tick.cycle = record.cycle;
      tick.t = record.t;
      if (has_world) part.on_loop(tick, fixture.backend());
      part.take(copy);
      newest_ns = record.t.ns;
      records[newest_ns] = {copy, *fixture.backend().object_pose("ball")};
    });
  }
  const CycleRecord& record() const { return records.at(ns(last.markers[0])).first; }
  // A set-point in a record; nullptr: the controllet is not active.
  ReferenceSample* reference(CycleRecord& in, const std::string& instance, const std::string& input) const {
    for (std::size_t k = 0; k < in.reference_count; ++k) {
      ReferenceSample& sample = in.references[k];
      const auto& of = fixture.run_context().layout->instances[sample.instance];
      if (of.name == instance && of.inputs[sample.input].name == input) return &sample;
    }
    return nullptr;
  }
  double output(const std::string& instance, const std::string& name) const {
    for (const auto& i : fixture.run_context().layout->instances) {
      for (const auto& o : i.outputs) {
        if (i.name == instance && o.name == name) return record().outputs[o.offset];
      }
    }
    throw std::out_of_range(name);
  }

  StateFixture fixture{scene_text()};
  Markers part{fixture.run_context()};
  Node listener{fixture.context(), "listener"};
  test::Received<MarkerArray> received{fixture, listener, "/multipanda/markers"};
  std::function<void(CycleRecord&)> edit;
  bool has_world = true;
  std::int64_t newest_ns = 0;
  std::map<std::int64_t, std::pair<CycleRecord, Pose>> records;
  MarkerArray last;
  void SetUp() override { fixture.executor().start(); }
  void TearDown() override { fixture.executor().stop(); }
};

TEST_F(Shown, ObjectsTargetsAndTanksAreWhereTheyBelong) {
  run(2500);  // the set-point has arrived
  const MarkerArray& message = next();

  const Marker& shelf = find(message, "objects", 0);
  expect_pose(shelf, turned({2, 1, 0.5}, 0.3, -0.2, 0.9));
  EXPECT_EQ(shelf.type, Marker::CUBE);
  EXPECT_LT((vector(shelf.scale) - Vector3(0.4, 0.3, 0.2)).norm(), 1e-12);
  const Pose X_WR = turned({2.5, -1, 0.4}, 1.2, 0.4, -0.3);
  expect_pose(find(message, "objects", 1), X_WR * turned({0, 0, 0.15}, 0, 0, 0));
  expect_pose(find(message, "objects", 2), X_WR * turned({0, 0, -0.15}, 0, 0, 0));
  expect_pose(find(message, "objects", 3), X_WR);
  EXPECT_LT((vector(find(message, "objects", 3).scale) - Vector3(0.05, 0.05, 0.3)).norm(), 1e-12);
  const Marker& ball = find(message, "objects", 4);
  expect_pose(ball, records.at(ns(ball)).second);
  const double fallen = 1 - ball.pose.position.z, t = 1e-9 * static_cast<double>(ns(ball));
  EXPECT_GT(t, 1);
  EXPECT_NEAR(fallen / (0.5 * 9.81 * t * t), 1, 0.01);

  // Targets: in the order of the scene's controllets and their inputs.
  CycleRecord copy = record();
  const ReferenceSample* joints = reference(copy, "left_joint", "joints");
  ASSERT_NE(joints, nullptr);
  expect_pose(find(message, "targets", 0), kLeftBase * hand_in_base(joints->values.data()));
  expect_pose(find(message, "targets", 1), kTarget, 1e-6);
  EXPECT_EQ(find(message, "targets", 1).points.size(), 6u);
  EXPECT_FALSE(there(message, "targets", 2)) << "the target of the force is 0 N";
  EXPECT_FALSE(there(message, "targets", 3)) << "the controllet is not active";

  const MultimodeController& modes = *fixture.run_context().modes;
  double greatest = 0;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    const Instance& instance = modes.instance(i);
    if (instance.name() == "right_ufic")
      greatest = instance.parameter(instance.find_parameter("tank_max_j"))[0];
  }
  ASSERT_GT(greatest, 0);
  for (const auto& [name, id] : {std::pair("force_tank_j", 0), std::pair("impedance_tank_j", 2)}) {
    const double energy = output("right_ufic", name);
    ASSERT_GT(energy, 0.1);
    const double height = 0.2 * energy / greatest;
    expect_pose(find(message, "tanks", id), kRightBase * turned({-0.25, 0.05 * id, 0.5 * height}, 0, 0, 0));
    EXPECT_NEAR(find(message, "tanks", id).scale.z, height, 1e-12);
    EXPECT_EQ(find(message, "tanks", id + 1).text,
              fmt::format("{} {:.2f} J", std::string(name).substr(0, std::string(name).size() - 2), energy));
  }
}

TEST_F(Shown, ForcesStartAtTheStiffnessFrameAndAreDeletedWhenTheyEnd) {
  std::array<double, 6> F{3, -4, 12, 0.1, 0.2, 0.3};
  double desired = -10;
  edit = [&](CycleRecord& record) {
    record.arms[0].has_contact_truth = true;
    record.arms[0].F_K_W_true = F;
    record.arms[1].has_wrench_estimate = true;
    record.arms[1].F_K_W_est = F;
    if (auto* wrench = reference(record, "right_ufic", "wrench")) wrench->values = {0, 0, desired};
  };
  const MarkerArray& message = next();
  const Pose X_WE_left = kLeftBase * hand_in_base(record().arms[0].q.data());
  const Pose X_WE_right = kRightBase * hand_in_base(record().arms[1].q.data());
  expect_arrow(find(message, "contact_forces", 0), (X_WE_left * kLeftK).position, {3, -4, 12});
  expect_arrow(find(message, "estimated_forces", 1), X_WE_right.position, {3, -4, 12});
  expect_arrow(find(message, "targets", 2), X_WE_right.position, {0, 0, -10});
  F = {0.3, -0.4, 0.8, 5, 5, 5};  // 0.94 N
  desired = 0;
  next();
  EXPECT_FALSE(there(last, "contact_forces", 0));
  EXPECT_FALSE(there(last, "estimated_forces", 1));
  EXPECT_FALSE(there(last, "targets", 2));
  F[0] = std::numeric_limits<double>::quiet_NaN();
  next();
  EXPECT_FALSE(there(last, "contact_forces", 0));
}

TEST_F(Shown, NamespacesIdsAndFramesStayWhileActionsChange) {
  const auto names = [](const MarkerArray& message) {
    std::vector<std::tuple<std::string, int, std::string, int>> all;
    for (const auto& marker : message.markers)
      all.emplace_back(marker.ns, marker.id, marker.header.frame_id, marker.type);
    return all;
  };
  const auto before = names(next());
  EXPECT_EQ(std::set(before.begin(), before.end()).size(), before.size());
  for (const auto& marker : last.markers) EXPECT_GT(marker.lifetime.sec, 0);
  EXPECT_TRUE(there(last, "tanks", 0) && there(last, "tanks", 3) && there(last, "targets", 1));
  run(6100);  // another law has the right arm
  next();
  EXPECT_EQ(names(last), before);
  EXPECT_TRUE(there(last, "targets", 0) && there(last, "objects", 4));
  for (const auto& [space, id] : {std::pair("tanks", 0), std::pair("tanks", 1), std::pair("tanks", 2),
                                  std::pair("tanks", 3), std::pair("targets", 1)})
    EXPECT_EQ(find(last, space, id).action, Marker::DELETE) << space << id;
}

// As under ros2_control, whose controller has no world to ask.
TEST_F(Shown, FixedObjectsAreWhereTheSceneHasThemWithoutAWorld) {
  has_world = false;
  next();
  expect_pose(find(last, "objects", 0), turned({2, 1, 0.5}, 0.3, -0.2, 0.9));
  EXPECT_TRUE(there(last, "objects", 1));
  EXPECT_FALSE(there(last, "objects", 4)) << "nobody knows where the ball is";
}

// Stamps are periods apart, and slow markers stay until the next but one.
TEST(Markers, AreSentAtTheRateOfTheScene) {
  for (const auto& [rate, period_ns, lifetime_s] :
       {std::tuple{"40", 25'000'000, 2}, {"0.5", 2'000'000'000, 4}}) {
    StateFixture fixture(scene_text() + "ros: {rates_hz: {markers: " + rate + "}}\n");
    Node listener(fixture.context(), "listener");
    test::Received<MarkerArray> received(fixture, listener, "/multipanda/markers");
    AdapterParts parts;
    parts.push_back(std::make_unique<Markers>(fixture.run_context()));
    fixture.executor().start();
    EXPECT_TRUE(test::wait_for([&] {
      fixture.run(500, parts);
      return received.count() >= 5;
    }));
    fixture.executor().stop();
    received.messages.erase(received.messages.begin());  // the first one may be that of any cycle
    std::vector<std::int64_t> stamps;
    for (const auto& message : received.messages) {
      stamps.push_back(ns(message.markers.at(0)));
      EXPECT_EQ((stamps.back() - stamps[0]) % period_ns, 0) << rate;
      EXPECT_EQ(message.markers[0].lifetime.sec, lifetime_s);
    }
    std::adjacent_difference(stamps.begin(), stamps.end(), stamps.begin());
    EXPECT_EQ(*std::min_element(stamps.begin() + 1, stamps.end()), period_ns) << rate;
  }
  StateFixture off(scene_text() + "ros: {rates_hz: {markers: 0}}\n"), on(scene_text());
  EXPECT_EQ(make_state(off.run_context()).size() + 1, make_state(on.run_context()).size());
}

// Without a viewer neither the loop nor the publisher's thread works for markers.
TEST(Markers, CostNothingWithoutAViewer) {
  StateFixture fixture(scene_text());
  Markers part(fixture.run_context());
  CycleRecord record(2, 0, 0);  // too short for this scene: publishing it would throw
  Tick tick;
  for (record.cycle = tick.cycle = 1; record.cycle < 500; ++tick.cycle, ++record.cycle) {
    part.on_loop(tick, fixture.backend());
    part.take(record);
  }
  EXPECT_EQ(fixture.node().published(), 0u);
}

}  // namespace
}  // namespace multipanda::ros::markers_test
