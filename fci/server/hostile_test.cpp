// Hostile programs at the ports of running virtual arms: one arm moves meanwhile and must not be affected.
// Lock-step, so that the test does not depend on the speed of this computer.
#include <arpa/inet.h>
#include <atomic>
#include <cstring>
#include <functional>
#include <future>
#include <limits>
#include <netinet/tcp.h>
#include <poll.h>
#include <random>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "core/testing/full_series.hpp"
#include "fci/server/virtual_arms.hpp"
#include "fci/wire/error_flags.hpp"
#include "fci/wire/frame_reader.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"
#include "fci/wire/vacuum.hpp"

namespace multipanda::fci::hostile_test {
namespace {

using Bytes = std::vector<std::byte>;
constexpr int kPatienceMs = 10000;  // for an answer: far longer than a working server needs

int cases(int full) { return multipanda::test::full_series() ? full : full / 10; }

bool wait_readable(int file, int timeout_ms) {
  pollfd p{file, POLLIN, 0};
  return ::poll(&p, 1, timeout_ms) > 0;
}

// A bare socket, closed at the end.
class Wire {
 public:
  explicit Wire(const ArmPlace& place, std::uint16_t port) {
    const sockaddr_in to = ipv4(place.address, port);
    file_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const timeval bound{kPatienceMs / 1000, 0};
    ::setsockopt(file_, SOL_SOCKET, SO_SNDTIMEO, &bound, sizeof bound);
    connected_ = ::connect(file_, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0;
    EXPECT_TRUE(connected_) << place.address << ':' << port << ' ' << std::strerror(errno);
  }
  Wire(const Wire&) = delete;
  ~Wire() { ::close(file_); }

  int file() const { return file_; }
  // False: the other end has closed.
  bool send(std::span<const std::byte> bytes) const {
    while (!bytes.empty()) {
      const auto n = ::send(file_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n <= 0) return false;
      bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
    return true;
  }
  // With a reset instead of an orderly shutdown.
  void tear_off() const {
    const linger now{1, 0};
    ::setsockopt(file_, SOL_SOCKET, SO_LINGER, &now, sizeof now);
  }
  // Waits until the other end has closed; false: timeout.
  bool closes() const {
    std::array<std::byte, 4096> waste;
    while (wait_readable(file_, kPatienceMs))
      if (::recv(file_, waste.data(), waste.size(), 0) <= 0) return true;
    return false;
  }

 private:
  int file_ = -1;
  bool connected_ = false;
};

// A minimal program at an arm's port.
class Program {
 public:
  explicit Program(const ArmPlace& place, std::uint16_t version = kNewestVersion)
      : d_(*dialect(version)), wire_(place, place.port) {
    udp_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in any = ipv4("0.0.0.0", 0);
    ::bind(udp_, reinterpret_cast<const sockaddr*>(&any), sizeof any);
    socklen_t size = sizeof any;
    ::getsockname(udp_, reinterpret_cast<sockaddr*>(&any), &size);
    send(ConnectRequest{version, ntohs(any.sin_port)});
    Message reply;
    connected_ = wait_reply(0, reply);
  }
  ~Program() { ::close(udp_); }

  bool connected() const { return connected_; }
  const Dialect& d() const { return d_; }
  const Wire& wire() const { return wire_; }
  const sockaddr_in& arm() const { return arm_; }  // the sender of its states

  template <class R>
  std::uint32_t send(const R& request) {
    std::array<std::byte, kMaxRequestSize> bytes;
    wire_.send(std::span(bytes).first(encode_request(d_, next_id_, request, bytes)));
    return next_id_++;
  }
  // The next reply to `id`; others are skipped.
  bool wait_reply(std::uint32_t id, Message& reply) {
    for (;;) {
      while (reader_.next(reply) == FrameReader::Next::message)
        if (reply.command_id == id) return true;
      if (!wait_readable(wire_.file(), kPatienceMs)) return false;
      const auto room = reader_.room();
      const auto n = ::recv(wire_.file(), room.data(), room.size(), 0);
      if (n <= 0) return false;
      reader_.received(static_cast<std::size_t>(n));
    }
  }
  template <class R>
  std::optional<Status> ask(const R& request) {
    return answer(R::kCommand, send(request));
  }
  std::optional<Status> answer(Command command, std::uint32_t id) {
    Message reply;
    Status status = Status::error;
    std::span<const std::byte> rest;
    if (!wait_reply(id, reply) || decode_reply(d_, command, reply.payload, status, rest) != WireResult::ok)
      return std::nullopt;
    return status;
  }

  bool receive(RobotState& state, int timeout_ms = kPatienceMs) {
    if (!wait_readable(udp_, timeout_ms)) return false;
    std::array<std::byte, kMaxStateSize> bytes;
    socklen_t size = sizeof arm_;
    const auto n = ::recvfrom(udp_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&arm_), &size);
    return n > 0 && decode(d_, std::span(bytes).first(static_cast<std::size_t>(n)), state) == WireResult::ok;
  }
  void command(const RobotCommand& command) {
    std::array<std::byte, kMaxCommandSize> bytes;
    send_datagram(std::span(bytes).first(encode(d_, command, bytes)));
  }
  void send_datagram(std::span<const std::byte> bytes) {
    ::sendto(udp_, bytes.data(), bytes.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&arm_),
             sizeof arm_);
  }
  // Waits until a state passes.
  bool wait_for(const std::function<bool(const RobotState&)>& passes) {
    RobotState state;
    for (int i = 0; i < 20000; ++i) {
      if (!receive(state)) return false;
      if (passes(state)) return true;
    }
    return false;
  }

 private:
  const Dialect& d_;
  Wire wire_;
  int udp_ = -1;
  sockaddr_in arm_{};
  std::uint32_t next_id_ = 0;
  bool connected_ = false;
  FrameReader reader_{HeaderKind::arm, 1 << 20};
};

bool is_moving(const RobotState& s) { return s.robot_mode == static_cast<std::uint8_t>(RobotMode::move); }
bool is_idle(const RobotState& s) { return s.robot_mode == static_cast<std::uint8_t>(RobotMode::idle); }

// A complete motion with zero torques, as any program would run it.
struct Motion {
  std::optional<Status> started, ended;
  std::uint64_t cycles = 0, errors = 0, gaps = 0;
  bool kept_moving = true;
};
Motion run_motion(Program& program, const std::function<bool(std::uint64_t)>& keep_on) {
  Motion motion;
  RobotState state;
  const std::uint32_t move = program.send(MoveRequest{});
  motion.started = program.answer(Command::move, move);
  if (motion.started != Status::motion_started || !program.wait_for(is_moving)) return motion;
  bool finishing = false;
  std::uint64_t last = 0;
  while (program.receive(state)) {
    motion.errors |= error_bits(state.errors) | error_bits(state.reflex_reason);
    if (last > 0 && state.message_id != last + 1) ++motion.gaps;
    last = state.message_id;
    if (!is_moving(state)) {
      motion.kept_moving = finishing;
      break;
    }
    ++motion.cycles;
    finishing = finishing || !keep_on(motion.cycles);
    RobotCommand command;
    command.message_id = state.message_id;
    command.torque_command_finished = finishing;
    program.command(command);
  }
  motion.ended = program.answer(Command::move, move);
  return motion;
}

class HostilePrograms : public testing::Test {
 protected:
  explicit HostilePrograms(bool vacuum = false) : arms_(two_arms(vacuum), options()) {
    arms_.start();
    victim_place_ = arms_.place(0);
    place_ = arms_.place(1);
  }

  static Scene two_arms(bool vacuum) {
    Scene scene = test::scene_of({test::arm_named("victim", test::pose(0, 0.6, 0)),
                                  test::arm_named("target", test::pose(0, -0.6, 0), !vacuum)});
    scene.arms[1].vacuum = vacuum;
    return scene;
  }
  static VirtualArmOptions options() {
    const ArmPlace any{
        .address = "127.0.0.1", .port = 0, .gripper_port = 0, .vacuum_port = 0, .versions = VersionRange{}};
    return {.places = {any, any}, .pace = WorldPace::lockstep};
  }

  // Runs `attack` while the victim moves; afterwards both arms must work.
  void under_attack(const std::function<void()>& attack) {
    std::atomic<bool> over{false};
    std::promise<void> begun;
    Motion victim;
    std::thread thread([&] {
      Program program(victim_place_);
      EXPECT_TRUE(program.connected());
      victim = run_motion(program, [&](std::uint64_t cycle) {
        if (cycle == 10) begun.set_value();
        return cycle < 50 || !over;
      });
      if (victim.cycles < 10) begun.set_value();
    });
    begun.get_future().wait();
    attack();
    over = true;
    thread.join();
    EXPECT_EQ(victim.started, Status::motion_started);
    EXPECT_TRUE(victim.kept_moving);
    EXPECT_EQ(victim.ended, Status::success);
    EXPECT_EQ(victim.errors, 0u);
    EXPECT_EQ(victim.gaps, 0u);
    EXPECT_TRUE(arms_.running());
    EXPECT_FALSE(arms_.failed()) << arms_.fault();

    // The attacked port serves the next program normally.
    auto program = arrive();
    ASSERT_TRUE(program);
    if (program->wait_for([](const RobotState& s) { return !is_moving(s); }))
      program->ask(AutomaticErrorRecoveryRequest{});
    ASSERT_TRUE(program->wait_for(is_idle));
    const Motion motion = run_motion(*program, [](std::uint64_t cycle) { return cycle < 20; });
    EXPECT_EQ(motion.ended, Status::success);
    EXPECT_EQ(motion.errors, 0u);
  }

  // The attacked arm's port takes one program at a time; the previous one may still be connected.
  std::unique_ptr<Program> arrive(std::uint16_t version = kNewestVersion) {
    for (int i = 0; i < 1000; ++i) {
      auto program = std::make_unique<Program>(place_, version);
      if (program->connected()) return program;
      std::this_thread::yield();
    }
    return nullptr;
  }

  PortStatistics target() const { return arms_.statistics(1); }

  VirtualArms arms_;
  ArmPlace victim_place_, place_;
};

Bytes noise(std::mt19937& random, std::size_t size) {
  Bytes bytes(size);
  for (std::byte& b : bytes) b = static_cast<std::byte>(random());
  return bytes;
}

TEST_F(HostilePrograms, NoiseBeforeAndAfterConnect) {
  under_attack([this] {
    std::mt19937 random(41);
    for (int i = 0; i < cases(300); ++i) {
      const Wire wire(place_, place_.port);
      wire.send(noise(random, random() % 900));
      if (i % 3 == 0) wire.tear_off();
    }
    for (int i = 0; i < cases(300); ++i) {
      auto program = arrive(static_cast<std::uint16_t>(4 + i % 7));
      ASSERT_TRUE(program);
      program->wire().send(noise(random, 12 + random() % 900));
      for (int k = 0; k < 5; ++k) program->send_datagram(noise(random, random() % 500));
      if (i % 3 == 0) program->wire().tear_off();
    }
  });
  EXPECT_GT(target().bad_requests, 0u);
}

TEST_F(HostilePrograms, MessagesThatAreTooShortTooLongOrOutOfOrder) {
  under_attack([this] {
    // What the server must answer by ending the connection
    const auto ends = [&](bool connected, std::uint32_t command, std::uint32_t size, std::size_t sent) {
      Bytes bytes(std::max<std::size_t>(sent, 12));
      encode(HeaderKind::arm, {command, 5, size}, bytes);
      bytes.resize(sent);
      if (connected) {
        auto program = arrive();
        ASSERT_TRUE(program);
        program->wire().send(bytes);
        EXPECT_TRUE(program->wire().closes()) << command << ' ' << size;
      } else {
        const Wire wire(place_, place_.port);
        wire.send(bytes);
        EXPECT_TRUE(wire.closes()) << command << ' ' << size;
      }
    };
    ends(false, 1, 125, 125);  // Move before Connect
    ends(false, 0, 15, 15);    // Connect, a byte short
    ends(false, 0, 17, 17);    // a byte long
    ends(true, 0, 16, 16);     // Connect twice
    ends(true, 1, 124, 124);   // Move, a byte short
    ends(true, 1, 68, 68);     // Move of another version
    ends(true, 2, 13, 13);     // StopMove with something
    ends(true, 12, 12, 12);    // no such request
    ends(true, 0xffffffff, 12, 12);
    ends(true, 3, 429, 12);  // longer than anything
    ends(true, 3, 0xffffffff, 12);
    ends(true, 3, 11, 12);  // shorter than a header
    ends(true, 3, 0, 12);
    // Half a message, then nothing; then the end
    for (const std::size_t part : {1u, 11u, 12u, 100u, 427u}) {
      auto program = arrive();
      ASSERT_TRUE(program);
      Bytes bytes(428);
      encode_request(program->d(), 9, SetCollisionBehaviorRequest{}, bytes);
      bytes.resize(part);
      program->wire().send(bytes);
      RobotState state;
      EXPECT_TRUE(program->receive(state)) << "half a message stops nothing";
    }
  });
  EXPECT_GE(target().bad_requests, 10u);
}

TEST_F(HostilePrograms, VersionsAndPortsThatAreNone) {
  under_attack([this] {
    for (const std::uint16_t version : std::initializer_list<std::uint16_t>{0, 3, 11, 0x7fff, 0xffff}) {
      const Wire wire(place_, place_.port);
      Bytes bytes(16);
      encode_request(kDialects.back(), 0, ConnectRequest{version, 4000}, bytes);
      wire.send(bytes);
      EXPECT_TRUE(wire.closes());
    }
    const Wire wire(place_, place_.port);
    Bytes bytes(16);
    encode_request(kDialects.back(), 0, ConnectRequest{10, 0}, bytes);
    wire.send(bytes);
    EXPECT_TRUE(wire.closes());
  });
}

TEST_F(HostilePrograms, NumbersThatAreNone) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN(),
                   kInf = std::numeric_limits<double>::infinity();
  under_attack([&] {
    auto program = arrive();
    ASSERT_TRUE(program);
    for (const double bad : {kNaN, kInf, -kInf, -1.0, 1e300}) {
      EXPECT_EQ(program->ask(SetJointImpedanceRequest{{100, 100, bad, 100, 100, 100, 100}}),
                Status::invalid_argument);
      EXPECT_EQ(program->ask(SetCartesianImpedanceRequest{{bad, 100, 100, 10, 10, 10}}),
                Status::invalid_argument);
      EXPECT_EQ(program->ask(SetEEToKRequest{{bad}}), Status::invalid_argument);
      EXPECT_EQ(program->ask(SetNEToEERequest{{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, bad}}),
                Status::invalid_argument);
      EXPECT_EQ(program->ask(SetLoadRequest{bad, {}, {}}), Status::invalid_argument);
      EXPECT_EQ(program->ask(SetLoadRequest{1, {}, {bad}}), Status::invalid_argument);
      if (bad != -1.0) {
        EXPECT_EQ(program->ask(SetEEToKRequest{{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, bad, 0, 1}}),
                  Status::invalid_argument);
        EXPECT_EQ(program->ask(SetLoadRequest{1, {0, bad, 0}, {}}), Status::invalid_argument);
      }
      if (bad != 1e300) {  // much, but a limit
        SetCollisionBehaviorRequest collision;
        collision.upper_torque_thresholds_nominal[3] = bad;
        EXPECT_EQ(program->ask(collision), Status::invalid_argument) << bad;
        MoveRequest move{MoveController::joint_impedance, MoveGenerator::joint_position};
        move.use_async_motion_generator = true;
        move.maximum_velocity.fill(bad);
        EXPECT_EQ(program->ask(move), Status::invalid_argument) << bad;
      }
      // A motion whose first or fiftieth command is not valid
      for (const int good : {0, 50}) {
        const std::uint32_t id = program->send(MoveRequest{});
        ASSERT_EQ(program->answer(Command::move, id), Status::motion_started);
        ASSERT_TRUE(program->wait_for(is_moving));
        RobotState state;
        for (int i = 0; i <= good; ++i) {
          ASSERT_TRUE(program->receive(state));
          RobotCommand command;
          command.message_id = state.message_id;
          if (i == good) command.tau_J_d[6] = bad == -1.0 ? kNaN : bad;
          program->command(command);
        }
        ASSERT_TRUE(program->wait_for([](const RobotState& s) { return !is_moving(s); }));
        const auto end = program->answer(Command::move, id);
        ASSERT_TRUE(end);
        EXPECT_TRUE(*end == Status::reflex_aborted || *end == Status::input_error_aborted) << text(*end);
        EXPECT_EQ(program->ask(AutomaticErrorRecoveryRequest{}), Status::success);
        ASSERT_TRUE(program->wait_for(is_idle));
      }
    }
  });
}

TEST_F(HostilePrograms, RequestsWithoutEnd) {
  under_attack([this] {
    std::mt19937 random(42);
    for (int i = 0; i < cases(50); ++i) {
      auto program = arrive(i % 2 == 0 ? 10 : 5);
      ASSERT_TRUE(program);
      RobotState state;
      ASSERT_TRUE(program->receive(state));
      // Models requested and never read: the server keeps a bounded part and gives up.
      Bytes many;
      for (std::uint32_t k = 0; k < 500; ++k) {
        Bytes one(14);
        if (program->d().has_model_text())
          one.resize(encode_request(program->d(), k, GetRobotModelRequest{}, one));
        else
          one.resize(encode_request(program->d(), k, LoadModelLibraryRequest{}, one));
        many.insert(many.end(), one.begin(), one.end());
      }
      program->wire().send(many);
      for (int k = 0; k < 2000; ++k) program->send_datagram(noise(random, 371));
    }
  });
  EXPECT_GT(target().bad_datagrams, 0u);
}

TEST_F(HostilePrograms, ConnectionsThatSayNothing) {
  under_attack([this] {
    std::vector<std::unique_ptr<Wire>> silent;
    for (int i = 0; i < 40; ++i) {
      silent.push_back(std::make_unique<Wire>(place_, place_.port));
      silent.push_back(std::make_unique<Wire>(victim_place_, victim_place_.port));
    }
    // The first one occupies the arm's only slot and loses it after a timeout.
    EXPECT_TRUE(silent.front()->closes());
    for (int i = 0; i < 40; i += 3) silent[static_cast<std::size_t>(i)]->tear_off();
  });
  EXPECT_GT(target().refused, 0u);
  EXPECT_GT(arms_.statistics(0).refused, 0u);
}

// A program that begins a motion and falls silent, or leaves: the world of the others continues.
TEST_F(HostilePrograms, MotionsThatAreAbandoned) {
  under_attack([this] {
    RobotState state;
    {
      auto program = arrive();
      ASSERT_TRUE(program);
      EXPECT_EQ(program->ask(MoveRequest{}), Status::motion_started);
      ASSERT_TRUE(program->wait_for(is_moving));
      for (int i = 0; i < 100; ++i) ASSERT_TRUE(program->receive(state)) << "waits for its first command";
    }
    auto program = arrive();
    ASSERT_TRUE(program);
    ASSERT_TRUE(program->wait_for(is_idle)) << "the motion ended with its program";
    const std::uint32_t move = program->send(MoveRequest{});
    EXPECT_EQ(program->answer(Command::move, move), Status::motion_started);
    ASSERT_TRUE(program->wait_for(is_moving));
    for (int i = 0; i < 10; ++i) {
      ASSERT_TRUE(program->receive(state));
      RobotCommand command;
      command.message_id = state.message_id;
      program->command(command);
    }
    // Silence: the arm stops by itself.
    ASSERT_TRUE(program->wait_for([](const RobotState& s) { return !is_moving(s); }));
    EXPECT_EQ(program->answer(Command::move, move), Status::reflex_aborted);
  });
}

// A program at a gripper's or vacuum gripper's port.
class Hand {
 public:
  Hand(const ArmPlace& place, std::uint16_t port, std::uint16_t version) : wire_(place, port) {
    connected_ = ask(GripperConnectRequest{version, 40000}) == GripperStatus::success;
  }
  bool connected() const { return connected_; }
  const Wire& wire() const { return wire_; }
  template <class R>
  std::uint32_t tell(const R& request) {
    std::array<std::byte, kMaxGripperRequestSize> bytes;
    wire_.send(std::span(bytes).first(encode_gripper_request(next_id_, request, bytes)));
    return next_id_++;
  }
  // None: no answer.
  template <class R>
  std::optional<GripperStatus> ask(const R& request) {
    const std::uint32_t id = tell(request);
    Message reply;
    for (;;) {
      while (reader_.next(reply) == FrameReader::Next::message) {
        GripperStatus status{};
        if (reply.command_id == id && decode_gripper_reply(reply.payload, status) == WireResult::ok)
          return status;
      }
      if (!wait_readable(wire_.file(), kPatienceMs)) return std::nullopt;
      const auto room = reader_.room();
      const auto n = ::recv(wire_.file(), room.data(), room.size(), 0);
      if (n <= 0) return std::nullopt;
      reader_.received(static_cast<std::size_t>(n));
    }
  }

 private:
  Wire wire_;
  bool connected_ = false;
  std::uint32_t next_id_ = 0;
  FrameReader reader_{HeaderKind::gripper, 1024};
};

class HostileToHands : public HostilePrograms {
 protected:
  using HostilePrograms::HostilePrograms;

  static std::unique_ptr<Hand> arrive_at(const ArmPlace& place, std::uint16_t port, std::uint16_t version) {
    for (int i = 0; i < 1000; ++i) {
      auto hand = std::make_unique<Hand>(place, port, version);
      if (hand->connected()) return hand;
      std::this_thread::yield();
    }
    return nullptr;
  }

  static void attack(const ArmPlace& place, std::uint16_t port, std::uint16_t version) {
    ASSERT_NE(port, 0);
    std::mt19937 random(43);
    for (int i = 0; i < cases(200); ++i) {
      {
        const Wire wire(place, port);
        wire.send(noise(random, random() % 200));
        if (i % 3 == 0) wire.tear_off();
      }
      auto hand = arrive_at(place, port, version);
      ASSERT_TRUE(hand);
      Bytes bytes = noise(random, 10 + random() % 60);
      // Half of them with a header that is one
      if (i % 2 == 0)
        encode(HeaderKind::gripper,
               {static_cast<std::uint32_t>(random() % 5), 7, 10 + static_cast<std::uint32_t>(random() % 50)},
               bytes);
      hand->wire().send(bytes);
    }
    for (const std::uint32_t size : {0u, 9u, 51u, 0xffffffffu}) {
      Bytes bytes(10);
      encode(HeaderKind::gripper, {4, 7, size}, bytes);
      const Wire wire(place, port);
      wire.send(bytes);
      EXPECT_TRUE(wire.closes()) << size;
    }
    // The first silent connection keeps the only slot until another program has waited for a timeout.
    std::vector<std::unique_ptr<Wire>> silent;
    for (int i = 0; i < 20; ++i) silent.push_back(std::make_unique<Wire>(place, port));
    while (!wait_readable(silent.front()->file(), 20)) Wire(place, port);
    silent.clear();
    // Endless requests whose answers are not read
    auto hand = arrive_at(place, port, version);
    ASSERT_TRUE(hand);
    Bytes many;
    for (std::uint32_t k = 0; k < 5000; ++k) {
      Bytes one(50);
      one.resize(version == kGripperVersion ? encode_gripper_request(k, GripperMoveRequest{0.02, 0.1}, one)
                                            : encode_gripper_request(k, VacuumRequest{50, 0, 10}, one));
      many.insert(many.end(), one.begin(), one.end());
    }
    hand->wire().send(many);
  }
};

TEST_F(HostileToHands, Gripper) {
  under_attack([this] {
    attack(place_, place_.gripper_port, kGripperVersion);
    // And it still works
    auto hand = arrive_at(place_, place_.gripper_port, kGripperVersion);
    ASSERT_TRUE(hand);
    constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
    for (const double bad : {kNaN, std::numeric_limits<double>::infinity(), -1.0}) {
      EXPECT_EQ(hand->ask(GripperMoveRequest{bad, 0.1}), GripperStatus::fail) << bad;
      EXPECT_EQ(hand->ask(GripperMoveRequest{0.03, bad}), GripperStatus::fail) << bad;
      EXPECT_EQ(hand->ask(GripperGraspRequest{0.03, 0.005, 0.005, 0.1, bad}), GripperStatus::fail) << bad;
    }
    EXPECT_EQ(hand->ask(GripperStopRequest{}), GripperStatus::success);
    EXPECT_EQ(hand->ask(GripperHomingRequest{}), GripperStatus::success);
    EXPECT_EQ(hand->ask(GripperMoveRequest{0.03, 0.1}), GripperStatus::success);
  });
}

class HostileToSuckers : public HostileToHands {
 protected:
  HostileToSuckers() : HostileToHands(true) {}
};

TEST_F(HostileToSuckers, Vacuum) {
  under_attack([this] {
    attack(place_, place_.vacuum_port, kVacuumVersion);
    auto sucker = arrive_at(place_, place_.vacuum_port, kVacuumVersion);
    ASSERT_TRUE(sucker);
    EXPECT_EQ(sucker->ask(VacuumRequest{50, 255, 100}), GripperStatus::fail);
    EXPECT_EQ(sucker->ask(VacuumRequest{50, 0, -1}), GripperStatus::fail);
    sucker->tell(VacuumRequest{50, 0, std::numeric_limits<std::int64_t>::max()});  // waits for a part
    EXPECT_EQ(sucker->ask(VacuumStopRequest{}), GripperStatus::success);
  });
}

// Datagrams to the victim's own port at the server, from an unrelated socket.
TEST_F(HostilePrograms, CommandsFromStrangers) {
  Program program(victim_place_);
  ASSERT_TRUE(program.connected());
  RobotState state;
  ASSERT_TRUE(program.receive(state));
  const sockaddr_in arm = program.arm();
  std::atomic<bool> over{false};
  std::thread stranger([&] {
    const int file = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    for (std::uint64_t id = state.message_id; !over; ++id) {
      std::array<std::byte, kMaxCommandSize> bytes;
      RobotCommand command;
      command.message_id = id % 4000;
      command.tau_J_d.fill(80);
      const auto size = encode(kDialects.back(), command, bytes);
      ::sendto(file, bytes.data(), size, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&arm), sizeof arm);
      if (id % 64 == 0) std::this_thread::yield();
    }
    ::close(file);
  });
  const Motion motion = run_motion(program, [](std::uint64_t cycle) { return cycle < 1000; });
  over = true;
  stranger.join();
  EXPECT_EQ(motion.ended, Status::success);
  EXPECT_EQ(motion.errors, 0u);
  const std::uint64_t received = arms_.statistics(0).commands_received;
  EXPECT_LE(received, motion.cycles) << "the stranger's do not arrive";
  EXPECT_GE(received + 2, motion.cycles);
}

}  // namespace
}  // namespace multipanda::fci::hostile_test
