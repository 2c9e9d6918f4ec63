// Both gripper connections with both ports of virtual arms: whole motions over loopback, in simulated time.
#include <arpa/inet.h>
#include <array>
#include <atomic>
#include <functional>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <gtest/gtest.h>

#include "fci/client/end_effector.hpp"
#include "fci/client/end_effector_connection.hpp"
#include "fci/client/tcp_channel.hpp"
#include "fci/server/virtual_arms.hpp"
#include "fci/wire/gripper.hpp"

namespace multipanda::fci::gripper_connection_test {
namespace {

const Vector3 kCup(0, 0, 0.1);  // in the flange [m]

Scene gripper_scene() {
  Scene scene;
  SceneArm hand, cup;
  hand.name = "hand";
  hand.model = "fr3";
  hand.q_start = load_robot("fr3").q_home;
  cup = hand;
  cup.name = "cup";
  cup.hand = false;
  cup.vacuum = true;
  cup.X_FE = Pose{Matrix3::Identity(), kCup};
  cup.X_WB.position = {0, 2, 0};
  scene.arms = {hand, cup};
  return scene;
}

// The world of this scene at free ports of a separate address.
struct Virtual {
  explicit Virtual(const char* address, Scene scene = gripper_scene()) {
    const ArmPlace any{.address = address, .port = 0, .gripper_port = 0, .vacuum_port = 0};
    arms = std::make_unique<VirtualArms>(std::move(scene), VirtualArmOptions{.places = {any, any}});
    arms->start();
  }
  std::unique_ptr<EndEffector> gripper() const {
    auto link = gripper_link("hand", arms->place(0).address, arms->place(0).gripper_port);
    link->connect();
    return link;
  }
  std::unique_ptr<EndEffector> vacuum() const {
    auto link = vacuum_link("cup", arms->place(1).address, arms->place(1).vacuum_port);
    link->connect();
    return link;
  }
  std::unique_ptr<VirtualArms> arms;
};

RequestAnswer wait(std::future<RequestAnswer> answer) {
  if (answer.wait_for(std::chrono::seconds(30)) != std::future_status::ready) return {false, "no answer"};
  return answer.get();
}

// The next state sent after this call.
multipanda::GripperState next_state(const EndEffector& link) {
  const auto& states = dynamic_cast<const EndEffectorConnection&>(link);
  const std::uint32_t seen = states.state_number() + 1;  // one may be in flight
  const HostTime begun = host_now();
  while (states.state_number() <= seen && host_now() - begun < std::chrono::seconds(20)) {
    std::this_thread::yield();
  }
  return link.state();
}

TEST(GripperLink, HomesMovesMissesAndGrasps) {
  const Virtual world("127.1.60.1");
  const auto link = world.gripper();
  EXPECT_FALSE(link->is_vacuum());
  EXPECT_EQ(next_state(*link).max_width, 0);
  EXPECT_TRUE(wait(link->request(GripperHoming{})).success);
  EXPECT_NEAR(next_state(*link).max_width, 0.08, 5e-4);
  EXPECT_NEAR(link->state().width, 0.08, 1e-3);
  EXPECT_TRUE(wait(link->request(GripperMove{.width = 0.03, .speed = 0.2})).success);
  EXPECT_NEAR(next_state(*link).width, 0.03, 6e-4);
  EXPECT_FALSE(link->state().moving);
  // Farther than it opens, and a grasp without an object
  EXPECT_FALSE(wait(link->request(GripperMove{.width = 0.1, .speed = 0.2})).success);
  const RequestAnswer miss = wait(link->request(GripperGrasp{.width = 0.04, .speed = 0.2, .force = 20}));
  EXPECT_FALSE(miss.success);
  EXPECT_NE(miss.reason.find("nothing of that width"), std::string::npos) << miss.reason;
  EXPECT_FALSE(next_state(*link).grasped);
  // Both fingers touch: an object of width 0
  EXPECT_TRUE(wait(link->request(GripperGrasp{.width = 0, .speed = 0.2, .force = 20})).success);
  EXPECT_TRUE(next_state(*link).grasped);
}

TEST(GripperLink, StopAndNewMotionsAbortTheOneThatRuns) {
  const Virtual world("127.1.60.2");
  const auto link = world.gripper();
  auto slow = link->request(GripperMove{.width = 0, .speed = 0.005});
  auto homing = link->request(GripperHoming{});
  const RequestAnswer replaced = wait(std::move(slow));
  EXPECT_FALSE(replaced.success);
  EXPECT_NE(replaced.reason.find("another motion"), std::string::npos) << replaced.reason;
  EXPECT_TRUE(wait(link->request(GripperStop{})).success);
  EXPECT_FALSE(wait(std::move(homing)).success);
  EXPECT_TRUE(wait(link->request(GripperStop{})).success);  // nothing runs
}

// The hand has whole motions only: widths are skipped while one runs, and the newest one is where it ends.
TEST(GripperLink, FollowsTheNewestWidthWithWholeMotions) {
  const Virtual world("127.1.60.7");
  const auto link = world.gripper();
  EXPECT_GT(next_state(*link).width, 0.075);
  const auto follow = [&](std::optional<double> width, double speed = 0.2) {
    const GripperFollow desired{.width = width, .speed = speed, .silence = 1};
    auto answer = link->request(desired);
    EXPECT_EQ(answer.wait_for(std::chrono::seconds(0)), std::future_status::ready);  // never waits
    EXPECT_TRUE(answer.get().success);
  };
  const auto until = [&](const auto& condition) {
    const HostTime begun = host_now();
    while (!condition() && host_now() - begun < std::chrono::seconds(20)) std::this_thread::yield();
    EXPECT_TRUE(condition());
  };
  follow(0.06, 0.05);
  until([&] { return link->state().moving; });
  for (int k = 1; k <= 30; ++k) follow(0.06 - 0.001 * k);
  until([&] {
    follow(0.03);
    return !link->state().moving && std::abs(link->state().width - 0.03) < 1e-3;
  });
  // A small change is ignored.
  const double here = next_state(*link).width;
  follow(0.031);
  EXPECT_NEAR(next_state(*link).width, here, 2e-4);
  EXPECT_FALSE(link->state().moving);
  // A hold ends the motion where it is.
  follow(0.07, 0.01);
  until([&] { return link->state().width > 0.034; });
  follow(std::nullopt);
  until([&] { return !link->state().moving; });
  EXPECT_LT(next_state(*link).width, 0.06);
  // In silence, too.
  EXPECT_TRUE(wait(link->request(GripperFollow{.width = 0.0, .speed = 0.005, .silence = 0.1})).success);
  until([&] { return link->state().moving; });
  until([&] { return !link->state().moving; });
  EXPECT_GT(next_state(*link).width, 0.01);
  // Any other motion ends the following.
  EXPECT_TRUE(wait(link->request(GripperMove{.width = 0.05, .speed = 0.2})).success);
  EXPECT_NE(wait(link->request(GripperFollow{.width = NAN})).reason.find("width"), std::string::npos);
  EXPECT_NEAR(next_state(*link).width, 0.05, 1e-3);
}

// A move alone would hold it with a force that is not known.
TEST(GripperLink, WhatAClosingMoveEndsOnIsGraspedAndKeptUntilAWiderWidth) {
  Scene scene = gripper_scene();
  SceneObject box;
  box.name = "box";
  box.fixed = false;
  box.mass = 0.2;
  box.size = {0.03, 0.04, 0.04};
  SceneObject table = box;
  table.name = "table";
  table.fixed = true;
  table.size = {0.3, 0.3, 0.1};
  const Pose X_WF = MujocoPlant(scene).world().X_WF(0);
  box.X_WO = X_WF * Pose{rotation_from_rpy({0, 0, -M_PI / 4}), {0, 0, 0.1034}};
  table.X_WO.position = box.X_WO.position - Vector3(0, 0, 0.02 + 0.05);
  scene.objects = {table, box};
  const Virtual world("127.1.60.8", scene);
  const auto link = world.gripper();
  const auto until = [&](double width, const auto& condition) {
    const HostTime begun = host_now();
    while (!condition() && host_now() - begun < std::chrono::seconds(20)) {
      EXPECT_TRUE(link->request(GripperFollow{.width = width, .speed = 0.2, .silence = 1}).get().success);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    EXPECT_TRUE(condition());
  };
  (void)next_state(*link);
  until(0.02, [&] { return link->state().grasped; });
  EXPECT_NEAR(link->state().width, 0.04, 2e-3);
  EXPECT_TRUE(wait(link->request(GripperFollow{})).success);
  EXPECT_TRUE(next_state(*link).grasped);  // also while nothing is followed
  until(0.06, [&] { return !link->state().grasped && link->state().width > 0.058; });
}

TEST(GripperLink, ImplausibleRequestsAreRefusedOnBothEnds) {
  const Virtual world("127.1.60.3");
  const auto link = world.gripper();
  EXPECT_NE(wait(link->request(GripperMove{.width = -1})).reason.find("width"), std::string::npos);
  EXPECT_NE(wait(link->request(GripperGrasp{.width = 0.01, .speed = 0.1, .force = NAN})).reason.find("force"),
            std::string::npos);
  EXPECT_NE(wait(link->request(VacuumOn{})).reason.find("does not support"), std::string::npos);
}

TEST(GripperLink, LossIsReportedAndReconnectingHelps) {
  auto world = std::make_unique<Virtual>("127.1.60.4");
  const auto link = world->gripper();
  const auto second = gripper_link("hand", "127.1.60.4", world->arms->place(0).gripper_port);
  EXPECT_THROW(second->connect(), ConnectionError);  // one program at a time
  auto running = link->request(GripperMove{.width = 0, .speed = 0.001});
  link->connect();
  const RequestAnswer lost = wait(std::move(running));
  EXPECT_FALSE(lost.success);
  EXPECT_TRUE(wait(link->request(GripperMove{.width = 0.05, .speed = 0.2})).success);
  world.reset();
  EXPECT_FALSE(wait(link->request(GripperMove{.width = 0.01, .speed = 0.2})).success);
  EXPECT_FALSE(link->state().present);
  EXPECT_THROW(link->connect(), ConnectionError);
}

// The sender of a request may be the thread that has to pass on the next stop of an arm. A gripper that
// accepts the connection and answers nothing before the request was refused: otherwise connect() waits for
// its whole timeout.
TEST(GripperLink, ARequestWhileItConnectsIsRefusedAtOnce) {
  const int silent = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = ::inet_addr("127.1.60.5");
  socklen_t size = sizeof at;
  ASSERT_EQ(::bind(silent, reinterpret_cast<sockaddr*>(&at), size), 0);
  ASSERT_EQ(::listen(silent, 1), 0);
  ::getsockname(silent, reinterpret_cast<sockaddr*>(&at), &size);
  const auto link = gripper_link("hand", "127.1.60.5", ntohs(at.sin_port));
  bool at_once = false;
  for (int tries = 0; tries < 10 && !at_once; ++tries) {  // a machine may stand still for the whole timeout
    std::thread connecting([&] {
      try {
        link->connect();
      } catch (const ConnectionError& error) {
        at_once = error.kind() == ConnectionError::Kind::lost;
      }
    });
    const int accepted = ::accept(silent, nullptr, nullptr);
    const RequestAnswer answer = wait(link->request(GripperMove{.width = 0.05, .speed = 0.1}));
    ::close(accepted);
    connecting.join();
    EXPECT_FALSE(answer.success);
    EXPECT_NE(answer.reason.find("not connected"), std::string::npos) << answer.reason;
  }
  EXPECT_TRUE(at_once);
  ::close(silent);
}

// A gripper whose datagrams the test sends: from its own port, or from another one of the same address.
class ToldGripper {
 public:
  explicit ToldGripper(const char* address) : at_(any(address)) {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    EXPECT_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&at_), sizeof at_), 0);
    EXPECT_EQ(::listen(listener_, 1), 0);
    for (int& udp : udp_) {
      udp = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
      const sockaddr_in port = any(address);
      EXPECT_EQ(::bind(udp, reinterpret_cast<const sockaddr*>(&port), sizeof port), 0);
    }
    socklen_t size = sizeof at_;
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&at_), &size);
  }
  ~ToldGripper() {
    for (const int file : {listener_, tcp_, udp_[0], udp_[1]}) ::close(file);
  }
  std::uint16_t port() const { return ntohs(at_.sin_port); }
  // Answers the client's Connect.
  void accept() {
    tcp_ = ::accept(listener_, nullptr, nullptr);
    std::array<std::byte, kGripperHeader + gripper_payload_size<GripperConnectRequest>()> bytes{};
    ASSERT_EQ(::recv(tcp_, bytes.data(), bytes.size(), MSG_WAITALL), static_cast<ssize_t>(bytes.size()));
    MessageHeader header;
    GripperConnectRequest request;
    ASSERT_EQ(decode(HeaderKind::gripper, std::span(bytes).first(kGripperHeader), header), WireResult::ok);
    ASSERT_EQ(decode_gripper(std::span<const std::byte>(bytes).subspan(kGripperHeader), request),
              WireResult::ok);
    client_ = any("127.0.0.1");
    client_.sin_port = htons(request.udp_port);
    std::array<std::byte, kGripperConnectReplySize> reply{};
    (void)encode_gripper_connect_reply(header.command_id, GripperStatus::success, kGripperVersion, reply);
    ASSERT_EQ(::send(tcp_, reply.data(), reply.size(), 0), static_cast<ssize_t>(reply.size()));
  }
  // The client's next request.
  GripperCommand next() {
    const timeval patience{.tv_sec = 20, .tv_usec = 0};
    ::setsockopt(tcp_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    std::array<std::byte, kMaxGripperRequestSize> bytes{};
    const auto head = std::span(bytes).first(kGripperHeader);
    EXPECT_EQ(::recv(tcp_, bytes.data(), kGripperHeader, MSG_WAITALL), static_cast<ssize_t>(kGripperHeader));
    EXPECT_EQ(decode(HeaderKind::gripper, head, asked_), WireResult::ok);
    const std::size_t left = std::min<std::size_t>(asked_.size, bytes.size()) - kGripperHeader;
    if (left > 0) EXPECT_EQ(::recv(tcp_, bytes.data(), left, MSG_WAITALL), static_cast<ssize_t>(left));
    return static_cast<GripperCommand>(asked_.command);
  }
  // To the last one.
  void answer(GripperStatus status) {
    std::array<std::byte, kGripperReplySize> reply{};
    (void)encode_gripper_reply(static_cast<std::uint16_t>(asked_.command), asked_.command_id, status, reply);
    ASSERT_EQ(::send(tcp_, reply.data(), reply.size(), 0), static_cast<ssize_t>(reply.size()));
  }
  void send(std::uint32_t number, double width, bool own_port = true, bool grasped = false) {
    std::array<std::byte, kGripperStateSize> bytes{};
    (void)encode_gripper(
        fci::GripperState{.message_id = number, .width = width, .max_width = 0.08, .is_grasped = grasped},
        bytes);
    EXPECT_GT(::sendto(udp_[own_port ? 0 : 1], bytes.data(), bytes.size(), 0,
                       reinterpret_cast<const sockaddr*>(&client_), sizeof client_),
              0);
  }

 private:
  static sockaddr_in any(const char* address) {
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_addr.s_addr = ::inet_addr(address);
    return at;
  }
  MessageHeader asked_;
  sockaddr_in at_, client_{};
  int listener_ = -1, tcp_ = -1;
  std::array<int, 2> udp_{-1, -1};
};

// Else an object would count as held, or as lost, for the rest of the run.
TEST(GripperLink, OneWrongDatagramDoesNotDeafenIt) {
  ToldGripper gripper("127.1.60.7");
  const auto link = gripper_link("hand", "127.1.60.7", gripper.port());
  std::thread connecting([&] { link->connect(); });
  gripper.accept();
  connecting.join();
  const auto& states = dynamic_cast<const EndEffectorConnection&>(*link);
  const auto reaches = [&](std::uint32_t number) {
    const HostTime begun = host_now();
    while (states.state_number() != number && host_now() - begun < std::chrono::seconds(20))
      std::this_thread::yield();
    return states.state_number() == number;
  };
  constexpr std::uint32_t kFar = 4'000'000'000;
  gripper.send(1, 0.01);
  ASSERT_TRUE(reaches(1));
  gripper.send(2, 0.05, false);  // another program at the same address
  gripper.send(kFar, 0.06, false);
  gripper.send(kFar, 0.07);
  gripper.send(2, 0.02);
  ASSERT_TRUE(reaches(2)) << states.state_number();
  EXPECT_EQ(link->state().width, 0.02);
  // Two that follow each other are believed: the gripper began to count again.
  gripper.send(kFar, 0.03);
  gripper.send(kFar + 1, 0.04);
  ASSERT_TRUE(reaches(kFar + 1)) << states.state_number();
  EXPECT_EQ(link->state().width, 0.04);
}

// A gripper whose states come or do not, and a stream of widths to it.
class ToldLink : public testing::Test {
 protected:
  ToldLink() : gripper_("127.1.60.9"), link_(gripper_link("hand", "127.1.60.9", gripper_.port())) {
    std::thread connecting([&] { link_->connect(); });
    gripper_.accept();
    connecting.join();
  }
  static bool until(const auto& condition) {
    const HostTime begun = host_now();
    while (host_now() - begun < std::chrono::seconds(20)) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }
  std::string follow(double width) {
    return wait(link_->request(GripperFollow{.width = width, .silence = 1})).reason;
  }
  // A stream closes the fingers, its move ends early, and a grasp begins.
  void grasp(const std::function<void()>& then = [] {}) {
    const std::jthread stream([&](const std::stop_token& stop) {
      for (; !stop.stop_requested(); std::this_thread::sleep_for(std::chrono::milliseconds(10))) {
        tell();
        (void)follow(0.02);
      }
    });
    EXPECT_EQ(gripper_.next(), GripperCommand::move);
    gripper_.answer(GripperStatus::unsuccessful);
    EXPECT_EQ(gripper_.next(), GripperCommand::grasp);
    then();
  }
  void tell() { gripper_.send(++number_, 0.05, true, grasped_); }

  ToldGripper gripper_;
  std::unique_ptr<EndEffector> link_;
  std::atomic<bool> grasped_{false};
  std::uint32_t number_ = 0;
};

// Where the fingers are is not known then: a move to the last known width might close them.
TEST_F(ToldLink, WithoutStatesNothingIsFollowedAndAMoveIsStopped) {
  EXPECT_NE(follow(0.08).find("states (UDP) do not arrive"), std::string::npos);
  EXPECT_TRUE(until([&] {
    tell();
    return follow(0.08).empty();
  }));
  EXPECT_EQ(gripper_.next(), GripperCommand::move);
  EXPECT_EQ(gripper_.next(), GripperCommand::stop);
  EXPECT_NE(follow(0.08).find("states (UDP) do not arrive"), std::string::npos);
}

// It would close on whatever comes between the fingers.
TEST_F(ToldLink, AHoldStopsAGraspThatHoldsNothingYet) {
  grasp();
  EXPECT_TRUE(wait(link_->request(GripperFollow{})).success);
  EXPECT_EQ(gripper_.next(), GripperCommand::stop);
}

TEST_F(ToldLink, AHoldLeavesAGraspThatHoldsSomething) {
  grasp([&] {
    grasped_ = true;
    EXPECT_TRUE(until([&] { return link_->state().grasped; }));
  });
  EXPECT_TRUE(wait(link_->request(GripperFollow{})).success);
  // Answered, and sent, after the hold: its thread has a turn in between.
  for (int k = 0; k < 20; ++k, std::this_thread::sleep_for(std::chrono::milliseconds(10))) tell();
  const auto homing = link_->request(GripperHoming{});
  EXPECT_EQ(gripper_.next(), GripperCommand::homing);
}

// As when it has not been homed.
TEST_F(ToldLink, AFailureIsToldOnce) {
  std::string why;
  EXPECT_TRUE(until([&] {
    tell();
    return follow(0.02).empty();
  }));
  EXPECT_EQ(gripper_.next(), GripperCommand::move);
  gripper_.answer(GripperStatus::fail);
  EXPECT_TRUE(until([&] {
    tell();
    why = follow(0.02);
    return !why.empty();
  }));
  EXPECT_NE(why.find("needs homing"), std::string::npos) << why;
  EXPECT_EQ(follow(0.02), "");
}

TEST(VacuumLink, HoldsAndDropsAPart) {
  Scene scene = gripper_scene();
  // The flange of the ready configuration points down; the part is below the cup, 3 mm away.
  SceneObject part;
  part.name = "part";
  part.fixed = false;
  part.mass = 0.2;
  part.size = {0.06, 0.06, 0.06};
  SceneObject table = part;
  table.name = "table";
  table.fixed = true;
  table.size = {0.3, 0.3, 0.1};
  MujocoPlant plant(scene);
  const Vector3 cup = plant.world().X_WF(1) * kCup;
  part.X_WO.position = cup - Vector3(0, 0, 0.033);
  table.X_WO.position = cup - Vector3(0, 0, 0.063 + 0.05);
  scene.objects = {table, part};
  const Virtual world("127.1.60.5", scene);
  const auto link = world.vacuum();
  EXPECT_TRUE(link->is_vacuum());
  EXPECT_FALSE(next_state(*link).grasped);
  EXPECT_TRUE(wait(link->request(VacuumOn{.pressure_mbar = 500, .timeout_s = 2})).success);
  EXPECT_TRUE(next_state(*link).grasped);
  EXPECT_TRUE(wait(link->request(VacuumDrop{.timeout_s = 2})).success);
  EXPECT_FALSE(next_state(*link).grasped);
  EXPECT_TRUE(wait(link->request(VacuumStop{})).success);
  EXPECT_NE(wait(link->request(GripperHoming{})).reason.find("does not support"), std::string::npos);
}

TEST(VacuumLink, WithoutAPartThereIsNoVacuumInTime) {
  const Virtual world("127.1.60.6");
  const auto link = world.vacuum();
  EXPECT_FALSE(wait(link->request(VacuumOn{.pressure_mbar = 500, .timeout_s = 0.2})).success);
  EXPECT_FALSE(next_state(*link).grasped);
}

}  // namespace
}  // namespace multipanda::fci::gripper_connection_test
