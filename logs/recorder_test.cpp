#include "logs/recorder.hpp"

#include <cmath>
#include <fcntl.h>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/record/arm_config.hpp"
#include "core/testing/drawn_sample.hpp"
#include "logs/arm_state_fields.hpp"
#include "logs/log_choice.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_files.hpp"

namespace multipanda::recorder_test {

namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

RecordLayout layout_of(std::size_t arms) {
  RecordLayout layout;
  for (std::size_t i = 0; i < arms; ++i) {
    layout.arms.push_back({std::string("arm").append(std::to_string(i)), 7 - i % 2});  // 7 and 6 joints
    RecordLayout::Instance instance;
    instance.name = std::string("law").append(std::to_string(i));
    instance.type = "cartesian_impedance";
    instance.arms = 1u << i;
    instance.inputs = {{"pose", "pose", "world"}, {"force", "wrench", "world"}};
    instance.parameters = {"stiffness"};
    instance.features = {"joint_limits"};
    instance.outputs = {{"position_error_m", 3 * i, 3}};
    layout.instances.push_back(instance);
  }
  layout.output_count = 3 * arms;
  layout.max_references = 2 * arms;
  return layout;
}

// Every number of a record follows from cycle, arm and joint, so that each message read back can be checked.
double value(std::uint64_t cycle, std::size_t arm, std::size_t joint, int what) {
  return static_cast<double>(cycle) + 0.1 * static_cast<double>(arm) + 0.01 * static_cast<double>(joint) +
         1e4 * what;
}

void fill(CycleRecord& record, std::uint64_t cycle, const RecordLayout& layout) {
  record.cycle = cycle;
  record.t.ns = static_cast<std::int64_t>(cycle) * 1'000'000;
  record.start.ns = 5'000'000'000 + static_cast<std::int64_t>(cycle) * 1'100'000;
  record.period_s = 0.001;
  record.stages = {1000, 2000, 3000, 4000, 5000, 15000};
  record.reference_count = 0;
  for (std::size_t i = 0; i < layout.arms.size(); ++i) {
    ArmSample& sample = record.arms[i];
    sample.sequence = cycle + 7;
    sample.t_robot_ns = static_cast<std::int64_t>(cycle) * 1'000'001;
    sample.owner = static_cast<std::uint16_t>(i);
    sample.due = true;
    sample.mode = static_cast<std::uint8_t>(ArmMode::move);
    sample.has_tau_ext = i == 0;
    sample.has_wrench_estimate = i == 0;
    sample.command_success_rate = value(cycle, i, 0, 11);
    sample.has_gripper = i == 1;
    sample.gripper_width = value(cycle, i, 0, 12);
    sample.gripper_max_width = 0.08;
    sample.gripper_grasped = cycle % 2 == 0;
    sample.gripper_moving = cycle % 3 == 0;
    for (std::size_t k = 0; k < layout.arms[i].joint_count; ++k) {
      sample.q[k] = value(cycle, i, k, 1);
      sample.dq[k] = value(cycle, i, k, 2);
      sample.tau_J[k] = value(cycle, i, k, 3);
      sample.tau_J_d[k] = value(cycle, i, k, 4);
      sample.tau_ext[k] = value(cycle, i, k, 5);
      sample.tau_controllet[k] = value(cycle, i, k, 6);
      sample.tau_feature[k] = 0.5;
      sample.tau_cmd[k] = sample.tau_controllet[k] + (k == 1 ? 0.0 : 0.5);  // joint 1 was limited
    }
    for (std::size_t k = 0; k < 6; ++k) sample.F_K_W_est[k] = value(cycle, i, k, 7);
    ReferenceSample& reference = record.references[record.reference_count++];
    reference.instance = static_cast<std::uint16_t>(i);
    reference.input = 0;
    reference.size = 7;
    for (std::size_t k = 0; k < 7; ++k) reference.values[k] = value(cycle, i, k, 8);
    for (std::size_t k = 0; k < 6; ++k) reference.rates[k] = value(cycle, i, k, 9);
    for (std::size_t k = 0; k < 3; ++k) record.outputs[3 * i + k] = i == 0 ? value(cycle, i, k, 10) : kNaN;
  }
}

template <typename M>
std::vector<M> read(const std::filesystem::path& log, const std::string& topic) {
  std::vector<M> out;
  McapReader reader(log);
  while (const auto message = reader.next()) {
    if (message->channel->topic == topic) out.push_back(from_cdr<M>(message->data));
  }
  return out;
}

// The loop's side: stores `cycles` records; with `wait`, as an unpaced loop does when the ring is full.
void leave_records(RecordRing& ring, const RecordLayout& layout, std::uint64_t first, std::uint64_t cycles,
                   bool wait) {
  for (std::uint64_t cycle = first; cycle < first + cycles; ++cycle) {
    CycleRecord* record = ring.ring.back();
    while (record == nullptr && wait) {
      std::this_thread::yield();
      record = ring.ring.back();
    }
    if (record == nullptr) {
      ring.dropped_records.fetch_add(1);
      continue;
    }
    fill(*record, cycle, layout);
    ring.ring.push();
  }
}

TEST(Recorder, FourArmsEverySample) {
  const TestFolder folder;
  const auto log = folder / "log.mcap";
  constexpr std::uint64_t kCycles = 5000;
  const RecordLayout layout = layout_of(4);
  RecordRing ring(layout, 256);
  Recorder recorder(log, layout, ring, std::vector<RecordedArm>(4), {.info = {{"scene", "four_arms"}}});
  leave_records(ring, layout, 1, kCycles, true);
  const RecorderStatus status = recorder.stop();
  EXPECT_EQ(status.cycles, kCycles);
  EXPECT_THAT(status.missing(), testing::IsEmpty());
  EXPECT_TRUE(status.writer.closed);

  for (std::size_t i = 0; i < 4; ++i) {
    const std::string arm = layout.arms[i].name;
    const std::size_t n = layout.arms[i].joint_count;
    const auto states = read<msg::ArmState>(log, "/" + arm + "/state");
    const auto commands = read<msg::ArmCommand>(log, "/" + arm + "/command");
    const auto references = read<msg::Reference>(log, "/law" + std::to_string(i) + "/pose");
    ASSERT_EQ(states.size(), kCycles);
    ASSERT_EQ(commands.size(), kCycles);
    ASSERT_EQ(references.size(), kCycles);
    for (std::uint64_t c = 1; c <= kCycles; ++c) {
      const msg::ArmState& state = states[c - 1];
      ASSERT_EQ(state.cycle, c);
      ASSERT_EQ(state.arm, arm);
      ASSERT_EQ(state.stamp.sec * 1'000'000'000LL + state.stamp.nanosec,
                static_cast<long long>(c) * 1'000'000);
      ASSERT_EQ(state.sequence, c + 7);
      ASSERT_EQ(state.mode, msg::ArmState::MODE_MOVE);
      ASSERT_EQ(state.q.size(), n);
      ASSERT_EQ(state.tau_ext.size(), i == 0 ? n : 0u);
      ASSERT_EQ(state.command_success_rate, value(c, i, 0, 11));
      ASSERT_EQ(state.has_gripper, i == 1);
      ASSERT_EQ(state.gripper_width, value(c, i, 0, 12));
      ASSERT_EQ(state.gripper_max_width, 0.08);
      ASSERT_EQ(state.gripper_grasped, c % 2 == 0);
      ASSERT_EQ(state.gripper_moving, c % 3 == 0);
      const msg::ArmCommand& command = commands[c - 1];
      ASSERT_EQ(command.owner, layout.instances[i].name);
      for (std::size_t k = 0; k < n; ++k) {
        ASSERT_EQ(state.q[k], value(c, i, k, 1));
        ASSERT_EQ(state.dq[k], value(c, i, k, 2));
        ASSERT_EQ(state.tau_j[k], value(c, i, k, 3));
        ASSERT_EQ(state.tau_j_d[k], value(c, i, k, 4));
        ASSERT_EQ(command.tau_controllet[k], value(c, i, k, 6));
        ASSERT_EQ(command.tau_feature[k], 0.5);
        ASSERT_EQ(command.limited[k], k == 1);
      }
      ASSERT_EQ(references[c - 1].value.size(), 7u);
      ASSERT_EQ(references[c - 1].rate.size(), 6u);
      ASSERT_EQ(references[c - 1].value[3], value(c, i, 3, 8));
      ASSERT_EQ(references[c - 1].rate[5], value(c, i, 5, 9));
      ASSERT_EQ(references[c - 1].kind, "pose");
      ASSERT_EQ(references[c - 1].frame, "world");
    }
    const auto outputs = read<msg::ControlletOutputs>(log, "/law" + std::to_string(i) + "/outputs");
    ASSERT_EQ(outputs.size(), i == 0 ? kCycles : 0u);
    for (std::uint64_t c = 1; c <= outputs.size(); ++c) {
      ASSERT_EQ(outputs[c - 1].cycle, c);
      ASSERT_EQ(outputs[c - 1].instance, layout.instances[i].name);
      ASSERT_EQ(outputs[c - 1].outputs.size(), 1u);
      const msg::OutputValues& output = outputs[c - 1].outputs[0];
      ASSERT_EQ(output.name, "position_error_m");
      for (std::size_t k = 0; k < 3; ++k)
        ASSERT_NEAR(output.values.at(k), value(c, i, k, 10), std::ldexp(std::abs(value(c, i, k, 10)), -24));
    }
  }
  const auto wrenches = read<msg::ArmWrench>(log, "/arm0/wrench");
  ASSERT_EQ(wrenches.size(), kCycles);
  EXPECT_EQ(wrenches[2].estimated.force.z, value(3, 0, 2, 7));
  EXPECT_EQ(wrenches[2].estimated.torque.x, value(3, 0, 3, 7));
  EXPECT_FALSE(wrenches[2].has_contact_truth);
  EXPECT_TRUE(read<msg::ArmWrench>(log, "/arm1/wrench").empty());
  const auto timing = read<msg::CycleTiming>(log, "/timing");
  ASSERT_EQ(timing.size(), kCycles);
  EXPECT_NEAR(timing[10].start, 10 * 0.0011, 1e-12);
  EXPECT_NEAR(timing[10].features, 3e-6, 1e-15);
  EXPECT_NEAR(timing[10].total, 15e-6, 1e-15);
}

// Every field of a message that the table of core/state/arm_sample.hpp names, in one of the log's messages.
TEST(Recorder, EveryQuantityOfAnArmIsInTheLog) {
  const TestFolder folder;
  const auto log = folder / "log.mcap";
  RecordLayout layout = layout_of(1);
  RecordRing ring(layout, 8);
  std::mt19937_64 random(11);
  std::vector<test::DrawnSample> drawn;
  {
    RecorderOptions options;
    options.every.report = 1;
    Recorder recorder(log, layout, ring, std::vector<RecordedArm>(1), options);
    for (std::uint64_t cycle = 1; cycle <= 3; ++cycle) {
      CycleRecord* record = ring.ring.back();
      ASSERT_NE(record, nullptr);
      fill(*record, cycle, layout);
      record->arms[0] = drawn.emplace_back(test::draw_sample(random, 7, cycle < 3)).sample;
      record->arms[0].owner = 0;
      ring.ring.push();
    }
  }
  const auto states = read<msg::ArmState>(log, "/arm0/state");
  const auto commands = read<msg::ArmCommand>(log, "/arm0/command");
  const auto wrenches = read<msg::ArmWrench>(log, "/arm0/wrench");
  const auto reports = read<msg::ArmReport>(log, "/arm0/report");
  ASSERT_EQ(states.size(), 3u);
  ASSERT_EQ(commands.size(), 3u);
  ASSERT_EQ(wrenches.size(), 2u);
  ASSERT_EQ(reports.size(), 2u);
  EXPECT_EQ(reports[1].q_d, drawn[1].numbers["q_d_rad"]);
  EXPECT_EQ(reports[1].theta[6], drawn[1].sample.theta[6]);
  EXPECT_EQ(reports[1].joint_collision[3], drawn[1].sample.joint_collision[3]);
  EXPECT_EQ(reports[1].x_be_d.position.z, drawn[1].sample.X_BE_d[2]);
  for (std::size_t i = 0; i < 3; ++i) {
    std::map<std::string, std::vector<double>> found;
    const auto take = [&](const auto& message) {
      for_each_number(message, [&](const char* name, const std::vector<double>& numbers) {
        EXPECT_TRUE(found.emplace(name, numbers).second) << name << " is in two messages";
      });
    };
    take(states[i]);
    take(commands[i]);
    if (i < 2) {
      take(wrenches[i]);
      take(reports[i]);
      EXPECT_TRUE(wrenches[i].has_estimate && wrenches[i].has_contact_truth);
      found["wrench_n_nm"] = numbers_of(wrenches[i].estimated);
      found["has_report"] = {1};
    }
    for (const auto& [name, expected] : drawn[i].numbers) {
      if (drawn[i].in_message.at(name) == "no_message") continue;
      const std::string known = drawn[i].known.at(name);
      if (i == 2 && (known != "always" || name == "has_report")) {
        EXPECT_TRUE(found[name].empty()) << name;
        continue;
      }
      ASSERT_EQ(found[name].size(), expected.size()) << name;
      for (std::size_t k = 0; k < expected.size(); ++k)
        EXPECT_NEAR(found[name][k], expected[k], 1e-14) << name;
    }
  }
}

// The summary of a pendulum against its closed form: a point mass m at distance l along the link's x, turning
// about y.
TEST(Recorder, ModelSummary) {
  constexpr double kMass = 2, kLength = 0.5, kGravity = 9.81;
  const std::string urdf = R"(<robot name="pendulum">
    <link name="base"/>
    <link name="tip"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
    <joint name="j1" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 1 0"/>
      <limit lower="-3" upper="3" velocity="10" effort="100"/></joint></robot>)";
  ArmModelSource source{
      .name = "pendulum", .urdf = urdf, .flange = "tip", .X_WB = {}, .limits = {}, .q_home = {}};
  source.X_WB.position = {1, 2, 3};
  RecordedArm arm{.model = std::make_shared<ArmModel>(source), .frames = {}, .tool = {}, .load = {}};
  arm.frames.X_FE.position = {kLength, 0, 0};
  RecordLayout layout;
  layout.arms = {{"arm", 1}};

  const TestFolder folder;
  const auto log = folder / "log.mcap";
  RecordRing ring(layout, 64);
  Recorder recorder(log, layout, ring, {arm}, {.every = {.model = 10}});
  for (std::uint64_t cycle = 1; cycle <= 31; ++cycle) {
    CycleRecord* record = ring.ring.back();
    ASSERT_NE(record, nullptr);
    record->cycle = cycle;
    record->arms[0].q[0] = 0.02 * static_cast<double>(cycle);
    record->arms[0].dq[0] = 0.3;
    ring.ring.push();
  }
  // From cycle 32 on it carries a load of 1 kg where its own mass is.
  Event config;
  config.cycle = 32;
  config.arm = 0;
  put_arm_config(config, arm.frames, {}, {.mass = 1, .p_FC = {kLength, 0, 0}});
  ASSERT_TRUE(ring.events.push(config));
  CycleRecord* last = ring.ring.back();
  ASSERT_NE(last, nullptr);
  last->cycle = 41;
  last->arms[0].q[0] = 0.1;
  last->arms[0].dq[0] = 0;
  ring.ring.push();
  EXPECT_EQ(recorder.stop().cycles, 32u);

  const auto models = read<msg::ModelSummary>(log, "/arm/model");
  ASSERT_EQ(models.size(), 5u);  // cycles 1, 11, 21, 31, 41
  for (std::size_t i = 0; i < 4; ++i) {
    const double q = 0.02 * static_cast<double>(10 * i + 1);
    EXPECT_EQ(models[i].cycle, 10 * i + 1);
    EXPECT_NEAR(models[i].pose.position.x, 1 + kLength * std::cos(q), 1e-12);
    EXPECT_NEAR(models[i].pose.position.y, 2, 1e-12);
    EXPECT_NEAR(models[i].pose.position.z, 3 - kLength * std::sin(q), 1e-12);
    EXPECT_NEAR(models[i].pose.orientation.y, std::sin(q / 2), 1e-12);
    EXPECT_NEAR(models[i].pose.orientation.w, std::cos(q / 2), 1e-12);
    EXPECT_NEAR(models[i].twist.linear.x, -0.3 * kLength * std::sin(q), 1e-12);
    EXPECT_NEAR(models[i].twist.linear.z, -0.3 * kLength * std::cos(q), 1e-12);
    EXPECT_NEAR(models[i].twist.angular.y, 0.3, 1e-12);
    EXPECT_NEAR(models[i].tau_gravity.at(0), -kMass * kGravity * kLength * std::cos(q), 1e-9);
    EXPECT_NEAR(models[i].tau_coriolis.at(0), 0, 1e-12);
  }
  EXPECT_NEAR(models[4].tau_gravity.at(0), -(kMass + 1) * kGravity * kLength * std::cos(0.1), 1e-9);
  const auto configs = read<msg::ArmConfig>(log, "/arm/config");
  ASSERT_EQ(configs.size(), 2u);
  EXPECT_EQ(configs[0].end_effector.position.x, kLength);
  EXPECT_EQ(configs[0].load_mass, 0);
  EXPECT_EQ(configs[1].load_mass, 1);
}

TEST(Recorder, EventsBecomeMessagesWithNames) {
  const TestFolder folder;
  const auto log = folder / "log.mcap";
  const RecordLayout layout = layout_of(2);
  RecordRing ring(layout, 16);
  {
    Recorder recorder(log, layout, ring, std::vector<RecordedArm>(2), {});
    Event event{.kind = EventKind::switched};
    event.t.ns = 2'000'000;
    event.cycle = 2;
    event.ticket = 5;
    event.started = 2, event.stopped = 1;
    event.arms = 2;
    event.size = 4;
    event.values = {1, 2, 3, 4};
    event.received.ns = 1'000'000, event.taken.ns = 3'000'000, event.first_torque.ns = 3'500'000;
    ring.events.push(event);
    event.kind = EventKind::switch_refused;
    event.verdict = Verdict::arm_stopped;
    event.received = {};
    ring.events.push(event);

    Event cut{.kind = EventKind::intervention, .intervention = Intervention::torque_rate_clamped};
    cut.cycle = 2;
    cut.arm = 1, cut.instance = 1, cut.joint = 3, cut.size = 2;
    cut.values = {12, 10};
    ring.events.push(cut);
    ring.events.push(cut);

    Event set{.kind = EventKind::parameter_set};
    set.cycle = 2;
    set.instance = 0, set.index = 0, set.size = 3;
    set.values = {100, 200.5, 300};
    ring.events.push(set);
    Event stop{.kind = EventKind::stopped};
    stop.cycle = 3;
    stop.arms = 3;
    ring.events.push(stop);
    leave_records(ring, layout, 1, 3, true);
  }
  const auto switches = read<msg::Switch>(log, "/switches");
  ASSERT_EQ(switches.size(), 2u);
  EXPECT_TRUE(switches[0].accepted);
  EXPECT_EQ(switches[0].request, 5u);
  EXPECT_THAT(switches[0].started, ElementsAre("law1"));
  EXPECT_THAT(switches[0].stopped, ElementsAre("law0"));
  EXPECT_THAT(switches[0].arms, ElementsAre("arm1"));
  EXPECT_THAT(switches[0].torque_step_computed, ElementsAre(3));
  EXPECT_THAT(switches[0].torque_step, ElementsAre(4));
  EXPECT_FALSE(switches[1].accepted);
  EXPECT_EQ(switches[1].verdict, to_string(Verdict::arm_stopped));
  const auto timing = read<msg::SwitchTiming>(log, "/switch_timing");
  ASSERT_EQ(timing.size(), 1u);
  EXPECT_DOUBLE_EQ(timing[0].waiting, 2e-3);
  EXPECT_DOUBLE_EQ(timing[0].computing, 0.5e-3);
  EXPECT_DOUBLE_EQ(timing[0].total, 2.5e-3);
  const auto cuts = read<msg::Intervention>(log, "/interventions");
  ASSERT_EQ(cuts.size(), 2u);
  EXPECT_EQ(cuts[1].code, to_string(Intervention::torque_rate_clamped));
  EXPECT_EQ(cuts[1].arm, "arm1");
  EXPECT_EQ(cuts[1].instance, "law1");
  EXPECT_EQ(cuts[1].joint, 3);
  EXPECT_EQ(cuts[1].value, 12);
  EXPECT_EQ(cuts[1].limit, 10);
  EXPECT_EQ(cuts[1].count, 2u);
  const auto events = read<msg::Event>(log, "/events");
  ASSERT_EQ(events.size(), 2u);
  EXPECT_EQ(events[0].text, "law0.stiffness = 100 200.5 300");
  EXPECT_THAT(events[0].values, ElementsAre(100, 200.5, 300));
  EXPECT_THAT(events[1].arms, ElementsAre("arm0", "arm1"));
}

// Without space on the disk, the loop's side does not change: every record is taken, and missing
// messages are counted.
TEST(RecorderFullDisk, LoopContinuesAndTheLogNamesWhatIsMissing) {
  const TestFolder folder;
  const auto log = folder / "log.mcap";
  constexpr std::uint64_t kCycles = 20000;
  const RecordLayout layout = layout_of(2);
  RecordRing ring(layout, 256);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit limit{1'000'000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &limit);
  Recorder recorder(log, layout, ring, std::vector<RecordedArm>(2), {.writer = {.chunk_bytes = 100'000}});
  leave_records(ring, layout, 1, kCycles, true);
  const RecorderStatus status = recorder.stop();
  setrlimit(RLIMIT_FSIZE, &before);

  EXPECT_EQ(status.cycles, kCycles);
  EXPECT_EQ(status.cycles_lost, 0u);
  EXPECT_GT(status.writer.messages_lost, 0u);
  // 2 arms x (config once; state, command, reference) + wrench, output of one, timing
  EXPECT_EQ(status.writer.messages_written + status.writer.messages_lost, 2 + kCycles * (2 * 3 + 1 + 1 + 1));
  ASSERT_EQ(status.missing().size(), 1u);
  EXPECT_THAT(status.missing()[0], HasSubstr("/arm0/state"));

  EXPECT_TRUE(status.writer.closed);
  EXPECT_EQ(read<msg::ArmState>(log, "/arm0/state").size() + status.writer.lost_by_topic.at("/arm0/state"),
            kCycles);
  McapReader reader(log);
  while (reader.next()) {
  }
  EXPECT_TRUE(reader.complete());
  EXPECT_EQ(reader.metadata().back().name, "missing");
  EXPECT_EQ(reader.metadata().back().values.at("messages_lost"), std::to_string(status.writer.messages_lost));
}

// A disk that stalls (a pipe that nobody reads): the loop drops and counts records, and never waits.
TEST(RecorderSlowDisk, LoopDropsAndTheGapIsInTheLog) {
  const TestFolder folder;
  const auto pipe_path = folder / "pipe";
  ASSERT_EQ(mkfifo(pipe_path.c_str(), 0600), 0);
  const int reading_end = open(pipe_path.c_str(), O_RDONLY | O_NONBLOCK);
  ASSERT_GE(reading_end, 0);
  constexpr std::uint64_t kCapacity = 64;
  const RecordLayout layout = layout_of(1);
  RecordRing ring(layout, kCapacity);
  Recorder recorder(pipe_path, layout, ring, std::vector<RecordedArm>(1),
                    {.writer = {.chunk_bytes = 20'000}});

  // Until the ring stays full for some time: the writer is blocked in the pipe.
  std::uint64_t cycle = 1;
  std::uint64_t dropped_in_a_row = 0;
  while (dropped_in_a_row < 50'000'000 / kCapacity) {
    const std::uint64_t before = ring.dropped_records.load();
    leave_records(ring, layout, cycle++, 1, false);
    dropped_in_a_row = ring.dropped_records.load() > before ? dropped_in_a_row + 1 : 0;
  }
  // The disk works again.
  std::string bytes;
  std::atomic<bool> done{false};
  std::thread disk([&] {
    std::array<char, 4096> block{};
    while (true) {
      const bool last = done.load();
      ssize_t n = 0;
      while ((n = ::read(reading_end, block.data(), block.size())) > 0)
        bytes.append(block.data(), static_cast<std::size_t>(n));
      if (last) return;
      std::this_thread::yield();
    }
  });
  leave_records(ring, layout, cycle, 100, true);
  const RecorderStatus status = recorder.stop();
  done = true;
  disk.join();
  close(reading_end);

  EXPECT_EQ(status.cycles + status.cycles_lost, cycle - 1 + 100);
  EXPECT_GT(status.cycles_lost, 0u);
  EXPECT_THAT(status.missing(), ElementsAre(HasSubstr(std::to_string(status.cycles_lost) + " cycles")));
  const auto log = folder / "log.mcap";
  put_content(log, bytes);
  const auto states = read<msg::ArmState>(log, "/arm0/state");
  EXPECT_EQ(states.size(), status.cycles);
  EXPECT_EQ(states.back().cycle, cycle - 1 + 100);
  std::uint64_t lost = 0;
  for (const auto& event : read<msg::Event>(log, "/events")) {
    EXPECT_EQ(event.kind, "records_lost");
    lost += static_cast<std::uint64_t>(event.values.at(1) - event.values.at(0)) + 1;
  }
  EXPECT_EQ(lost, status.cycles_lost);
  EXPECT_EQ(read<msg::CycleTiming>(log, "/timing").back().records_lost, lost);
}

TEST(Recorder, RefusesMismatchedInput) {
  const TestFolder folder;
  const RecordLayout layout = layout_of(2);
  RecordRing ring(layout, 4);
  EXPECT_THROW(Recorder(folder / "log.mcap", layout, ring, std::vector<RecordedArm>(1), {}),
               std::invalid_argument);
  EXPECT_THROW(Recorder(folder / "none" / "log.mcap", layout, ring, std::vector<RecordedArm>(2), {}),
               std::runtime_error);
  const auto first = make_run_directory(folder / "runs", "two_arms");
  const auto second = make_run_directory(folder / "runs", "two_arms");
  EXPECT_NE(first, second);
  EXPECT_TRUE(std::filesystem::is_directory(second));
  EXPECT_THROW(make_run_directory("/proc/none", "two_arms"), std::runtime_error);
}

}  // namespace

namespace {

TEST(LogEvery, TakesGroupsOneAfterTheOther) {
  LogEvery every;
  EXPECT_EQ(every.text(), "");
  every.set("all=100");
  every.set("state=1");
  every.set("timing=0");
  EXPECT_EQ(every.state, 1u);
  EXPECT_EQ(every.command, 100u);
  EXPECT_EQ(every.timing, 0u);
  EXPECT_EQ(every.model, 100u);
  EXPECT_EQ(every.text(),
            "command=100 wrench=100 references=100 outputs=100 timing=0 model=100 report=100 "
            "objects=100");
}

TEST(LogEvery, RefusesWhatItDoesNotUnderstandAndChangesNothing) {
  for (const char* wrong : {"", "state", "state=", "state=x", "state=1.5", "state=-1", "state=10 ",
                            "states=10", "=10", "state=99999999999999999999", "state=1000001"}) {
    LogEvery every;
    try {
      every.set(wrong);
      ADD_FAILURE() << wrong;
    } catch (const std::invalid_argument& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("groups: state, command, wrench")) << wrong;
    }
    EXPECT_EQ(every.text(), "") << wrong;
  }
}

TEST(EpisodeMarks, HaveTheNamesOfTheirKinds) {
  EXPECT_THAT(episode_marks(), testing::ElementsAre("start", "success", "failure", "discard"));
  EXPECT_EQ(to_string(EpisodeMark::Kind::discard), "discard");
}

}  // namespace

}  // namespace multipanda::recorder_test
