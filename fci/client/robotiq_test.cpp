#include <array>
#include <atomic>
#include <cstdlib>
#include <fcntl.h>
#include <mutex>
#include <poll.h>
#include <stdexcept>
#include <termios.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "core/types/time.hpp"
#include "fci/client/end_effector.hpp"

// Against a gripper emulated from Robotiq's manual of the 2F-85 on a pseudo-terminal: Modbus RTU, slave 9.
// Nothing here was tried on hardware.
namespace multipanda::fci::robotiq_test {
namespace {

using Bytes = std::vector<unsigned char>;

// The check of Modbus from its table-free definition in the other direction: 0x8005 on reflected bits.
unsigned crc_of(const Bytes& bytes) {
  const auto mirrored = [](unsigned value, int bits) {
    unsigned result = 0;
    for (int k = 0; k < bits; ++k) result |= (value >> k & 1u) << (bits - 1 - k);
    return result;
  };
  unsigned crc = 0xFFFF;
  for (const unsigned char byte : bytes) {
    crc ^= mirrored(byte, 8) << 8u;
    for (int k = 0; k < 8; ++k) crc = ((crc & 0x8000u) != 0 ? crc << 1u ^ 0x8005u : crc << 1u) & 0xFFFFu;
  }
  return mirrored(crc, 16);
}

class Device {
 public:
  static constexpr double kOpen = 3, kClosed = 228;  // positions at the ends

  Device() : master_(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)) {
    if (master_ < 0 || ::grantpt(master_) != 0 || ::unlockpt(master_) != 0)
      throw std::runtime_error("no pseudo-terminal");
    path_ = ::ptsname(master_);
    slave_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);  // so that it lives while none uses it
    termios line{};
    ::tcgetattr(slave_, &line);
    ::cfmakeraw(&line);
    ::tcsetattr(slave_, TCSANOW, &line);
    thread_ = std::thread([this] { serve(); });
  }
  ~Device() {
    ending_ = true;
    thread_.join();
    ::close(slave_);
    ::close(master_);
  }
  const std::string& path() const { return path_; }
  void mute(bool on) { muted_ = on; }  // its answers are lost
  void cut(bool on) { cut_ = on; }     // and what is written
  void report(int fault) { fault_ = fault; }
  void sweep(double s) { activation_ = s; }  // an activation that moves its fingers
  void leave(const std::array<unsigned char, 6>& out,
             double position = 100) {  // as a program or its supply does
    const std::lock_guard lock(mutex_);
    out_ = out;
    position_ = position;
  }
  double farthest() {  // target ahead of the fingers
    const std::lock_guard lock(mutex_);
    return std::exchange(farthest_, 0);
  }
  void garble(int answers) { garbled_ = answers; }
  void put_object(double position) { object_ = position; }  // fingers close no farther; 255: nothing
  double position() {
    const std::lock_guard lock(mutex_);
    return position_;
  }
  bool goes() {
    const std::lock_guard lock(mutex_);
    return (out_[0] & 8u) != 0;
  }
  std::vector<int> targets() {  // that were written, repetitions once
    const std::lock_guard lock(mutex_);
    return targets_;
  }
  std::array<unsigned char, 6> out() {
    const std::lock_guard lock(mutex_);
    return out_;
  }
  int foreign() const { return foreign_; }  // frames that are not of the protocol

 private:
  void serve() {
    Bytes got;
    HostTime then = host_now();
    while (!ending_) {
      pollfd readable{.fd = master_, .events = POLLIN, .revents = 0};
      (void)::poll(&readable, 1, 1);
      std::array<unsigned char, 256> some{};
      const ssize_t count = (readable.revents & POLLIN) != 0 ? ::read(master_, some.data(), some.size()) : 0;
      if (count > 0) got.insert(got.end(), some.begin(), some.begin() + count);
      if (cut_) got.clear();
      const HostTime now = host_now();
      const std::lock_guard lock(mutex_);
      live(seconds(now - then));
      then = now;
      take(got);
    }
  }
  // Moves with 20 to 150 mm/s; 0.37 mm a step.
  void live(double dt) {
    if ((out_[0] & 1u) == 0) {
      active_s_ = 0;
      return;
    }
    active_s_ += dt;
    if (active_s_ < activation_ && activation_ > kActivation)
      position_ = std::min(kClosed, position_ + 20 * dt);
    if ((out_[0] & 8u) == 0 || active_s_ < activation_) return;
    const double speed = (20 + 130 * out_[4] / 255.0) / (85 / (kClosed - kOpen));
    const double most = std::min<double>(kClosed, object_);
    const double target = std::clamp<double>(out_[3], kOpen, position_ <= most ? most : position_);
    const double away = target - position_;
    position_ += std::clamp(away, -speed * dt, speed * dt);
  }
  void take(Bytes& got) {
    while (got.size() >= 8) {
      const std::size_t size = got[1] == 0x10 ? 15 : 8;
      if (got.size() < size) return;
      const Bytes frame(got.begin(), got.begin() + static_cast<std::ptrdiff_t>(size) - 2);
      const unsigned check = got[size - 2] | static_cast<unsigned>(got[size - 1]) << 8u;
      got.erase(got.begin(), got.begin() + static_cast<std::ptrdiff_t>(size));
      if (check != crc_of(frame) || frame[0] != 9) {
        ++foreign_;
        got.clear();
        return;
      }
      answer(frame);
    }
  }
  void answer(const Bytes& frame) {
    const auto is = [&](const Bytes& head) { return std::equal(head.begin(), head.end(), frame.begin()); };
    Bytes reply{9, frame[1]};
    if (is({9, 0x10, 0x03, 0xE8, 0, 3, 6})) {
      std::copy(frame.begin() + 7, frame.end(), out_.begin());
      if ((out_[0] & 8u) != 0) farthest_ = std::max(farthest_, std::abs(out_[3] - position_));
      if ((out_[0] & 8u) != 0 && (targets_.empty() || targets_.back() != out_[3]))
        targets_.push_back(out_[3]);
      reply.insert(reply.end(), {0x03, 0xE8, 0, 3});
    } else if (is({9, 0x03, 0x07, 0xD0, 0, 3})) {
      const bool active = (out_[0] & 1u) != 0, done = active_s_ >= activation_, goes = (out_[0] & 8u) != 0;
      const bool there = std::abs(std::clamp<double>(out_[3], kOpen, kClosed) - position_) < 0.5;
      const unsigned object = there ? 3 : position_ >= object_ - 0.5 && out_[3] > position_ ? 2 : 0;
      const unsigned state = active ? (done ? 3 : 1) : 0;
      const auto first = static_cast<unsigned char>((active ? 1u : 0u) | (goes ? 8u : 0u) | state << 4u |
                                                    (goes && done ? object << 6u : 0u));
      reply.insert(reply.end(), {6, first, 0, static_cast<unsigned char>(fault_), out_[3],
                                 static_cast<unsigned char>(position_), 0});
    } else {
      ++foreign_;
      return;
    }
    const unsigned check = crc_of(reply);
    reply.push_back(static_cast<unsigned char>(check));
    reply.push_back(static_cast<unsigned char>(check >> 8u));
    if (garbled_ > 0 && garbled_-- > 0) reply[2] ^= 0x55u;
    if (!muted_) (void)!::write(master_, reply.data(), reply.size());
  }

  static constexpr double kActivation = 0.05;  // [s]
  int master_, slave_ = -1;
  std::string path_;
  std::thread thread_;
  std::atomic<bool> ending_{false}, muted_{false}, cut_{false};
  std::atomic<int> garbled_{0}, foreign_{0}, fault_{0};
  std::atomic<double> object_{255}, activation_{kActivation};
  std::mutex mutex_;
  std::array<unsigned char, 6> out_{};
  std::vector<int> targets_;
  double position_ = 100, active_s_ = 0, farthest_ = 0;
};

struct Rig {
  Device device;
  std::unique_ptr<EndEffector> link = robotiq_link("left", device.path(), "2f-85");

  RequestAnswer ask(const GripperRequest& request) {
    auto answer = link->request(request);
    if (answer.wait_for(std::chrono::seconds(30)) != std::future_status::ready) return {false, "no answer"};
    return answer.get();
  }
  static bool until(const std::function<bool()>& condition) {
    const HostTime begun = host_now();
    while (!condition() && host_now() - begun < std::chrono::seconds(20))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return condition();
  }
  void home() {
    link->connect();
    const RequestAnswer homed = ask(GripperHoming{});
    ASSERT_TRUE(homed.success) << homed.reason;
  }
};

TEST(Robotiq, MovesNothingBeforeItIsHomedThenMovesAndGrasps) {
  Rig rig;
  rig.link->connect();
  EXPECT_TRUE(rig.link->state().present);
  const RequestAnswer early = rig.ask(GripperMove{.width = 0.03});
  EXPECT_NE(early.reason.find("homed first"), std::string::npos) << early.reason;
  EXPECT_NE(rig.ask(GripperFollow{.width = 0.03}).reason.find("homed first"), std::string::npos);
  EXPECT_EQ(rig.device.position(), 100);
  EXPECT_EQ(rig.link->state().max_width, 0);
  EXPECT_TRUE(rig.ask(GripperHoming{}).success);
  EXPECT_EQ(rig.link->state().max_width, 0.085);
  EXPECT_NEAR(rig.link->state().width, 0.085, 5e-4);
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.0425, .speed = 0.15}).success);
  EXPECT_NEAR(rig.device.position(), (Device::kOpen + Device::kClosed) / 2, 1.5);
  EXPECT_NEAR(rig.link->state().width, 0.0425, 6e-4);
  // 150 mm/s is the fastest, 127.5 N half of 20 to 235 N.
  rig.device.put_object(150);
  EXPECT_FALSE(rig.ask(GripperGrasp{.width = 0.001, .speed = 0.15, .force = 127.5}).success);
  EXPECT_EQ(rig.device.out()[4], 255);
  EXPECT_EQ(rig.device.out()[5], 128);
  EXPECT_TRUE(Rig::until([&] { return !rig.device.goes(); }));  // it lets go of what does not fit
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.06, .speed = 0.15}).success);
  EXPECT_TRUE(rig.ask(GripperGrasp{.width = 0.029, .speed = 0.15, .force = 40}).success);
  EXPECT_TRUE(rig.link->state().grasped);
  EXPECT_NEAR(rig.link->state().width, 0.085 * (Device::kClosed - 150) / (Device::kClosed - Device::kOpen),
              6e-4);
  EXPECT_FALSE(rig.ask(GripperGrasp{.width = 0.029}).success);
  EXPECT_TRUE(rig.link->state().grasped);
  EXPECT_NE(rig.ask(VacuumOn{}).reason.find("no suction"), std::string::npos);
  EXPECT_EQ(rig.device.foreign(), 0);
}

TEST(Robotiq, FollowsAStreamOfWidthsContinuously) {
  Rig rig;
  rig.home();
  const std::size_t before = rig.device.targets().size();
  // A sine of 0.5 Hz, 20 to 60 mm, at 30 Hz.
  constexpr int kCount = 60;
  double farthest = 0, least = 1, most = 0;
  const HostTime begun = host_now();
  for (int k = 0; k < kCount; ++k) {
    const double s = k / 30.0, width = 0.04 + 0.02 * std::cos(M_PI * s);
    EXPECT_TRUE(rig.ask(GripperFollow{.width = width, .speed = 0.15, .silence = 1}).success);
    const int target = rig.device.targets().empty() ? 0 : rig.device.targets().back();
    farthest = std::max(farthest, static_cast<double>(target));
    least = std::min(least, rig.link->state().width);
    most = std::max(most, rig.link->state().width);
    std::this_thread::sleep_for(std::chrono::nanoseconds(begun.ns + (k + 1) * 33333333LL - host_now().ns));
  }
  const auto targets = rig.device.targets();
  // 40 mm are 106 positions there and back; a busy computer may skip some of the 60 widths.
  EXPECT_GT(targets.size() - before, 30U);
  EXPECT_LT(least, 0.024);
  EXPECT_GT(most, 0.05);
  EXPECT_NEAR(farthest, Device::kClosed - 0.02 / 0.085 * (Device::kClosed - Device::kOpen), 2);
  EXPECT_TRUE(rig.device.goes());
}

TEST(Robotiq, SilenceAndAHoldEndTheMotionWhereItIs) {
  Rig rig;
  rig.home();
  for (const bool silent : {true, false}) {
    EXPECT_TRUE(rig.ask(GripperMove{.width = 0.085, .speed = 0.15}).success);
    EXPECT_TRUE(rig.ask(GripperFollow{.width = 0.0, .speed = 0.02, .silence = silent ? 0.3 : 1.0}).success);
    EXPECT_TRUE(Rig::until([&] { return rig.device.position() > 10; }));
    if (!silent) EXPECT_TRUE(rig.ask(GripperFollow{}).success);
    EXPECT_TRUE(Rig::until([&] { return !rig.device.goes(); }));
    EXPECT_LT(rig.device.position(), 200);
    EXPECT_TRUE(Rig::until([&] { return !rig.link->state().moving; }));
  }
}

TEST(Robotiq, WhatItFollowsOntoStaysHeldInSilenceAndUntilAWiderWidth) {
  Rig rig;
  rig.home();
  rig.device.put_object(120);
  const auto follow = [&](double width) {
    EXPECT_TRUE(rig.ask(GripperFollow{.width = width, .speed = 0.15, .force = 50, .silence = 0.3}).success);
  };
  EXPECT_TRUE(Rig::until([&] {
    follow(0.01);
    return rig.link->state().grasped;
  }));
  std::this_thread::sleep_for(std::chrono::milliseconds(400));  // longer than the silence
  EXPECT_TRUE(rig.link->state().grasped && rig.device.goes());
  const auto targets = rig.device.targets();
  follow(0.03);  // between what it holds and closed
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(rig.device.targets(), targets);
  EXPECT_TRUE(Rig::until([&] {
    follow(0.07);
    return !rig.link->state().grasped && rig.link->state().width > 0.068;
  }));
}

TEST(Robotiq, AStopEndsWhatRuns) {
  Rig rig;
  rig.home();
  auto slow = rig.link->request(GripperMove{.width = 0, .speed = 0.02});
  EXPECT_TRUE(Rig::until([&] { return rig.device.position() > 8; }));
  EXPECT_TRUE(rig.ask(GripperStop{}).success);
  EXPECT_FALSE(slow.get().success);
  EXPECT_TRUE(Rig::until([&] { return !rig.device.goes(); }));
  EXPECT_TRUE(rig.ask(GripperFollow{.width = 0.0, .speed = 0.02, .silence = 1}).success);
  EXPECT_TRUE(Rig::until([&] { return rig.device.goes(); }));
  EXPECT_TRUE(rig.ask(GripperStop{}).success);
  EXPECT_TRUE(Rig::until([&] { return !rig.device.goes(); }));
}

TEST(Robotiq, GarbageIsAskedAgainAndSilenceIsALoss) {
  Rig rig;
  rig.home();
  rig.device.garble(3);
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.02, .speed = 0.15}).success);
  auto running = rig.link->request(GripperMove{.width = 0.08, .speed = 0.02});
  rig.device.mute(true);
  const RequestAnswer lost = running.get();
  EXPECT_NE(lost.reason.find("no longer answers"), std::string::npos) << lost.reason;
  EXPECT_FALSE(rig.link->state().present);
  EXPECT_NE(rig.ask(GripperMove{.width = 0.02}).reason.find("restart the run"), std::string::npos);
  EXPECT_THROW(robotiq_link("right", rig.device.path(), "2f-85")->connect(), std::runtime_error);
  rig.device.mute(false);
  EXPECT_TRUE(Rig::until([&] { return rig.link->state().present; }));
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.02, .speed = 0.15}).success);
}

TEST(Robotiq, MotionEndsWhenItsLineIsSilentAndItIsThereAgainWhenItAnswers) {
  Rig rig;
  rig.home();
  const auto closes = [&] {
    EXPECT_TRUE(rig.ask(GripperMove{.width = 0.085, .speed = 0.15}).success);
    EXPECT_TRUE(rig.ask(GripperFollow{.width = 0, .speed = 0.02, .silence = 1}).success);
    EXPECT_TRUE(Rig::until([&] { return rig.device.position() > 10; }));
  };
  closes();
  rig.device.mute(true);  // what is written arrives
  EXPECT_TRUE(Rig::until([&] { return !rig.device.goes(); }));
  EXPECT_TRUE(Rig::until([&] { return !rig.link->state().present; }));
  EXPECT_LT(rig.device.position(), 100);
  EXPECT_NE(rig.ask(GripperStop{}).reason.find("stop is sent nevertheless"), std::string::npos);
  rig.device.mute(false);
  EXPECT_TRUE(Rig::until([&] { return rig.link->state().present; }));
  closes();
  rig.device.cut(true);
  EXPECT_TRUE(Rig::until([&] { return !rig.link->state().present; }));
  rig.link->connect();  // a known one is waited for, so that stops reach it
  EXPECT_FALSE(rig.link->state().present);
  rig.device.cut(false);
  EXPECT_TRUE(Rig::until([&] { return rig.link->state().present && !rig.device.goes(); }));
  EXPECT_LT(rig.device.position(), 100);
  EXPECT_TRUE(rig.ask(GripperStop{}).success);
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.02, .speed = 0.15}).success);
}

TEST(Robotiq, WhatHoldsOnASilentLineStaysHeld) {
  Rig rig;
  rig.home();
  rig.device.put_object(150);
  EXPECT_TRUE(rig.ask(GripperGrasp{.width = 0.029, .speed = 0.15, .force = 40}).success);
  for (const bool reconnects : {false, true}) {
    rig.device.mute(true);
    EXPECT_TRUE(Rig::until([&] { return !rig.link->state().present; }));
    EXPECT_FALSE(rig.link->state().grasped);
    if (reconnects) rig.link->connect();
    rig.device.mute(false);
    EXPECT_TRUE(Rig::until([&] { return rig.link->state().grasped; }));
    EXPECT_TRUE(rig.device.goes());
  }
  EXPECT_TRUE(rig.ask(GripperStop{}).success);
  EXPECT_TRUE(Rig::until([&] { return !rig.device.goes(); }));
}

// A program that ends stops what moves; the next one, too, and it moves nothing before homing.
TEST(Robotiq, NoMotionOutlivesItsProgram) {
  Rig rig;
  rig.home();
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.085, .speed = 0.15}).success);
  EXPECT_TRUE(rig.ask(GripperFollow{.width = 0, .speed = 0.02, .silence = 1}).success);
  EXPECT_TRUE(Rig::until([&] { return rig.device.goes(); }));
  rig.link.reset();
  EXPECT_FALSE(rig.device.goes());
  rig.device.leave({9, 0, 0, 255, 0, 0}, 20);
  rig.link = robotiq_link("left", rig.device.path(), "2f-85");
  rig.link->connect();
  EXPECT_TRUE(Rig::until([&] { return !rig.device.goes(); }));
  EXPECT_LT(rig.device.position(), 200);
  EXPECT_NE(rig.ask(GripperMove{.width = 0.03}).reason.find("homed first"), std::string::npos);
  EXPECT_NE(rig.ask(GripperFollow{.width = 0.03}).reason.find("homed first"), std::string::npos);
  EXPECT_FALSE(rig.device.goes());
}

// Steps in 0.3 s at 20, 50 and 150 mm/s, from 85 mm in 225 of them; one more for rounding.
TEST(Robotiq, TargetsAreAShortWayAheadOfTheFingers) {
  Rig rig;
  rig.home();
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.04, .speed = 0.15}).success);
  (void)rig.device.farthest();
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.02, .speed = 0.02}).success);
  EXPECT_LE(rig.device.farthest(), 0.3 * 0.02 / 0.085 * 225 + 1);
  EXPECT_NEAR(rig.link->state().width, 0.02, 6e-4);
  EXPECT_TRUE(rig.ask(GripperMove{.width = 0.085, .speed = 0.15}).success);
  EXPECT_NEAR(rig.device.farthest(), 0.3 * 0.15 / 0.085 * 225, 20);
  EXPECT_TRUE(rig.ask(GripperFollow{.width = 0, .speed = 0.05, .silence = 1}).success);
  EXPECT_TRUE(Rig::until([&] { return rig.device.position() > 50 || !rig.link->state().moving; }));
  EXPECT_LE(rig.device.farthest(), 0.3 * 0.05 / 0.085 * 225 + 1);
}

TEST(Robotiq, AStopEndsItsActivationAndNothingElseBeginsOne) {
  Rig rig;
  rig.home();
  rig.device.sweep(20);
  rig.device.leave({});
  EXPECT_TRUE(Rig::until([&] { return rig.link->state().max_width == 0; }));
  auto homing = rig.link->request(GripperHoming{});
  EXPECT_TRUE(Rig::until([&] { return rig.device.position() > 110; }));
  EXPECT_TRUE(rig.ask(GripperStop{}).success);
  EXPECT_FALSE(homing.get().success);
  EXPECT_TRUE(Rig::until([&] { return rig.device.out()[0] == 0; }));
  EXPECT_LT(rig.device.position(), Device::kClosed);

  rig.device.sweep(0.05);
  EXPECT_TRUE(rig.ask(GripperHoming{}).success);
  rig.device.sweep(20);
  auto move = rig.link->request(GripperMove{.width = 0, .speed = 0.02});
  rig.device.leave({}, 40);
  EXPECT_NE(move.get().reason.find("it was reset"), std::string::npos);
  EXPECT_TRUE(rig.ask(GripperStop{}).success);
  EXPECT_NE(rig.ask(GripperFollow{.width = 0.03}).reason.find("homed first"), std::string::npos);
  EXPECT_TRUE(Rig::until([&] { return rig.device.out()[0] == 0; }));
  EXPECT_LT(rig.device.position(), Device::kClosed);
}

TEST(Robotiq, FaultsEndTheFollowingAndAreReported) {
  Rig rig;
  rig.home();
  EXPECT_TRUE(rig.ask(GripperFollow{.width = 0, .speed = 0.02, .silence = 1}).success);
  EXPECT_TRUE(Rig::until([&] { return rig.device.goes() && rig.device.position() > 10; }));
  rig.device.report(0x0E);
  std::string why;
  EXPECT_TRUE(Rig::until([&] {
    why = rig.ask(GripperFollow{.width = 0, .speed = 0.02, .silence = 1}).reason;
    return !why.empty();
  }));
  EXPECT_NE(why.find("fault 14"), std::string::npos) << why;
  EXPECT_TRUE(Rig::until([&] { return !rig.device.goes() && !rig.link->state().moving; }));
}

TEST(Robotiq, ImpossibleSpeedsAndForcesAreRefused) {
  Rig rig;
  rig.home();
  const auto out = rig.device.out();
  const auto refused = [&](const GripperRequest& request, const char* part) {
    const RequestAnswer answer = rig.ask(request);
    EXPECT_FALSE(answer.success);
    EXPECT_NE(answer.reason.find(part), std::string::npos) << answer.reason;
  };
  refused(GripperFollow{.width = 0.05, .speed = 0.001}, "0.001 m/s: 0.02 to 0.15 m/s");
  refused(GripperFollow{.width = 0.05, .force = 1}, "1 N: 20 to 235 N");
  refused(GripperMove{.width = 0.05, .speed = 0.2}, "0.2 m/s: 0.02 to 0.15 m/s");
  refused(GripperGrasp{.width = 0.05, .speed = 0.01}, "0.01 m/s");
  refused(GripperGrasp{.width = 0.05, .force = 1000}, "1000 N: 20 to 235 N");
  EXPECT_EQ(rig.device.out(), out);
}

TEST(Robotiq, WithoutItsPortOrAnAnswerTheRemedyIsNamed) {
  EXPECT_THROW((void)robotiq_link("left", "/dev/null", "2f-200"), std::invalid_argument);
  const auto link = robotiq_link("left", "/dev/no-such-port", "2f-140");
  try {
    link->connect();
    FAIL();
  } catch (const std::runtime_error& wrong) {
    EXPECT_NE(std::string(wrong.what()).find("name its port"), std::string::npos) << wrong.what();
  }
  EXPECT_FALSE(link->state().present);
}

}  // namespace
}  // namespace multipanda::fci::robotiq_test
