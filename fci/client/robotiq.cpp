#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <mutex>
#include <optional>
#include <poll.h>
#include <stdexcept>
#include <sys/ioctl.h>
#include <termios.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include "fci/client/end_effector.hpp"

// A Robotiq 2F-85 or 2F-140, as in its instruction manual: Modbus RTU at 115200 baud, 8N1, slave 9. Three
// output registers from 0x03E8 (activation, go; position 0 open to 255 closed; speed, force), three input
// registers from 0x07D0 (activation, object; fault, echo of the position; position, current).
namespace multipanda::fci {
namespace robotiq {
namespace {

using Bytes = std::vector<unsigned char>;

constexpr unsigned char kSlave = 9, kWrite = 0x10, kRead = 0x03;
constexpr unsigned char kActivate = 0x01, kGo = 0x08;  // bits of the first output
constexpr double kAnswer = 0.05, kLost = 0.5;          // patience with one answer, and with silence [s]
constexpr double kUnheard = 1;                         // commands are sent so long without an answer [s]
constexpr double kPeriod = 0.01;                       // of the exchange [s]
constexpr double kHoming = 60, kMotion = 30;           // [s]
constexpr double kFollowed = 0.002;                    // what is held stays held below this opening [m]
// No farther ahead of the fingers than what they do in this time is written as their target, so that they end
// there if the program or the line dies [s].
constexpr double kAhead = 0.3;
constexpr int kFull = 255, kFirstFailure = 8;  // greatest position, least fault that prevents motion

struct Model {
  const char* name;
  double stroke;                              // [m]
  double slowest, fastest, weakest, firmest;  // [m/s], [N]
};
constexpr std::array<Model, 2> kModels{Model{"2f-85", 0.085, 0.02, 0.15, 20, 235},
                                       Model{"2f-140", 0.14, 0.03, 0.25, 10, 125}};

// CRC-16 of Modbus: polynomial 0xA001, from 0xFFFF, low byte first.
void seal(Bytes& frame) {
  unsigned crc = 0xFFFF;
  for (const unsigned char byte : frame) {
    crc ^= byte;
    for (int k = 0; k < 8; ++k) crc = (crc & 1u) != 0 ? crc >> 1u ^ 0xA001u : crc >> 1u;
  }
  frame.push_back(static_cast<unsigned char>(crc));
  frame.push_back(static_cast<unsigned char>(crc >> 8u));
}

unsigned char portion(double value, double least, double most) {
  return static_cast<unsigned char>(
      std::lround(kFull * std::clamp((value - least) / (most - least), 0.0, 1.0)));
}

class Robotiq final : public EndEffector {
 public:
  Robotiq(const std::string& name, std::string port, const std::string& model)
      : who_("the Robotiq gripper of arm " + name + " at " + port), port_(std::move(port)) {
    const auto found = std::ranges::find(kModels, model, &Model::name);
    if (found == kModels.end()) throw std::invalid_argument(who_ + ": no model '" + model + "'");
    model_ = *found;
  }
  ~Robotiq() override { disconnect("the program ends"); }

  void connect() override;
  bool is_vacuum() const override { return false; }
  std::future<RequestAnswer> request(const GripperRequest& request) override;
  multipanda::GripperState state() const noexcept override {
    return {.present = present_,
            .width = width_,
            .max_width = max_width_,
            .grasped = present_ && grasped_,
            .moving = moving_};
  }

 private:
  enum class Phase : std::uint8_t { idle, reset, activate, find_closed, find_open, move, grasp, follow };
  struct Command {
    unsigned char action = 0, position = 0, speed = 0, force = 0;
    bool operator==(const Command&) const = default;
  };
  struct Status {
    unsigned char action = 0;  // as written
    bool active = false, goes = false;
    int object = 0;  // 0: moves, 1, 2: stopped by something while opening, closing, 3: at the position
    int fault = 0, echo = 0, position = 0;
  };

  void disconnect(const std::string& why);
  void run();
  Bytes exchange(Bytes request, std::size_t answer_size) const;
  bool write(const Command& command) const;
  std::optional<Status> read() const;
  void turn(const Status& status);
  void go(double position, double speed, double force);
  int next() const;
  void halt();
  std::string fault() const {
    return "it reports fault " + std::to_string(last_.fault) + ": see its manual, then home it";
  }
  std::string impossible(double speed, double force) const;
  double position_of(double width) const { return closed_ - width / model_.stroke * (closed_ - open_); }
  void finish(bool success, std::string why = {});
  double width_of(int position) const {
    return model_.stroke * std::clamp((closed_ - position) / (closed_ - open_), 0.0, 1.0);
  }

  const std::string who_, port_;
  Model model_{};
  int file_ = -1;
  std::thread thread_;
  std::atomic<bool> ending_{false};
  std::atomic<double> width_{0}, max_width_{0};
  std::atomic<bool> present_{false}, grasped_{false}, moving_{false};

  std::mutex mutex_;  // protects the following members
  std::condition_variable asked_;
  bool news_ = false;
  Phase phase_ = Phase::idle;
  Command command_;
  std::optional<Command> written_;  // unknown while it is not confirmed
  int goal_ = 0, reach_ = 1;        // position where the motion ends, and how far ahead one is written
  bool known_ = false;              // it has answered once
  int turns_ = 0;                   // since the command was written
  double open_ = 3, closed_ = 230;  // positions at the ends, of usual fingers until homing has found them
  Status last_;
  GripperGrasp grasp_;
  GripperFollow follow_;
  HostTime until_{};  // silence of widths, or patience with a motion
  std::optional<std::promise<RequestAnswer>> answer_;
};

HostTime after(double s) { return host_now() + std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * s)); }

void Robotiq::disconnect(const std::string& why) {
  ending_ = true;
  asked_.notify_all();
  if (thread_.joinable()) thread_.join();
  const std::lock_guard lock(mutex_);
  halt();
  constexpr int kTries = 3;
  for (int k = 0; k < kTries && known_ && file_ >= 0 && written_ != command_; ++k)
    if (write(command_)) written_ = command_;
  finish(false, why);
  present_ = moving_ = false;
  if (file_ >= 0) {
    (void)::ioctl(file_, TIOCNXCL);
    ::close(file_);
  }
  file_ = -1;
}

void Robotiq::connect() {
  disconnect("it is being reconnected");
  const auto fail = [&](const std::string& why) {
    disconnect(why);
    throw std::runtime_error(
        who_ + ": " + why +
        "; look at its supply and cable, name its port (ls /dev/serial/by-id) and join its group (dialout)");
  };
  file_ = ::open(port_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  termios line{};
  if (file_ < 0 || ::ioctl(file_, TIOCEXCL) != 0 || ::tcgetattr(file_, &line) != 0)
    return fail(std::string("its port cannot be opened: ") + std::strerror(errno));
  ::cfmakeraw(&line);
  ::cfsetspeed(&line, B115200);
  line.c_cflag |= CLOCAL | CREAD;
  if (::tcsetattr(file_, TCSANOW, &line) != 0)
    return fail(std::string("its port cannot be set: ") + std::strerror(errno));
  std::optional<Status> status;
  for (const HostTime end = after(kLost); !status && host_now() < end;) status = read();
  if (!status && !known_) return fail("it does not answer");  // a known one is connected once it answers
  if (status) {
    const std::lock_guard lock(mutex_);
    known_ = true;
    last_ = *status;
    // Taken over as it is: it keeps what it holds, and a running motion ends.
    const bool moves = status->goes && status->object == 0;
    written_ = command_ = {status->action, static_cast<unsigned char>(status->echo), 0, 0};
    if (moves) command_.action = kActivate;
    if (!status->active) command_ = {};
    if (!status->goes || status->object != 2) grasped_ = false;
    width_ = width_of(status->position);
  }
  present_ = status.has_value();
  ending_ = false;
  thread_ = std::thread([this] { run(); });  // also if it is silent: what ends its motion is still sent
}

// The answer to a request, without its check; empty: none, or a damaged one.
Bytes Robotiq::exchange(Bytes request, std::size_t answer_size) const {
  seal(request);
  (void)::tcflush(file_, TCIFLUSH);
  if (::write(file_, request.data(), request.size()) != static_cast<ssize_t>(request.size())) return {};
  Bytes answer;
  for (const HostTime end = after(kAnswer); answer.size() < answer_size + 2;) {
    const double left = seconds(end - host_now());
    pollfd readable{.fd = file_, .events = POLLIN, .revents = 0};
    if (left <= 0 || ::poll(&readable, 1, 1 + static_cast<int>(1e3 * left)) <= 0) return {};
    std::array<unsigned char, 64> some{};
    const ssize_t count = ::read(file_, some.data(), answer_size + 2 - answer.size());
    if (count <= 0) return {};
    answer.insert(answer.end(), some.begin(), some.begin() + count);
  }
  Bytes body(answer.begin(), answer.end() - 2), sealed = body;
  seal(sealed);
  return sealed == answer && body[0] == kSlave && body[1] == request[1] ? body : Bytes{};
}

bool Robotiq::write(const Command& c) const {
  const Bytes request{kSlave, kWrite, 0x03, 0xE8, 0, 3, 6, c.action, 0, 0, c.position, c.speed, c.force};
  return !exchange(request, 6).empty();
}

std::optional<Robotiq::Status> Robotiq::read() const {
  const Bytes answer = exchange({kSlave, kRead, 0x07, 0xD0, 0, 3}, 9);
  if (answer.empty() || answer[2] != 6) return std::nullopt;
  const unsigned char* r = answer.data() + 3;
  return Status{.action = static_cast<unsigned char>(r[0] & (kActivate | kGo)),
                .active = (r[0] >> 4u & 3u) == 3,
                .goes = (r[0] & kGo) != 0,
                .object = r[0] >> 6u,
                .fault = r[2] & 0x0F,
                .echo = r[3],
                .position = r[4]};
}

void Robotiq::run() {
  HostTime heard = host_now();
  std::unique_lock lock(mutex_);
  while (!ending_) {
    const bool asked = std::exchange(news_, false);
    lock.unlock();
    const auto status = read();  // first: one that was reset must not be told to activate
    lock.lock();
    if (status) {
      heard = host_now();
      present_ = true;
      ++turns_;
      turn(*status);
    }
    const double silent = seconds(host_now() - heard);
    if (silent > kLost) {
      present_ = moving_ = false;
      halt();
      finish(false, "it no longer answers: look at its supply and cable");
    }
    if (written_ != command_ && (asked || silent < kUnheard)) {
      const Command desired = command_;
      written_.reset();
      lock.unlock();
      const bool wrote = write(desired);
      lock.lock();
      turns_ = 0;
      if (wrote) written_ = desired;
    }
    asked_.wait_for(lock, std::chrono::duration<double>(kPeriod), [&] { return news_ || ending_; });
  }
}

// What follows from the newest status. With the mutex.
void Robotiq::turn(const Status& status) {
  last_ = status;
  width_ = width_of(status.position);
  const bool is_command =
      written_ == command_ && turns_ > 1;  // the first status may be older than the command
  const bool settled = is_command && status.echo == command_.position &&
                       (status.object == 3 ? status.echo == goal_ : status.object != 0);
  const bool holds = status.goes && status.object == 2 && phase_ != Phase::move;
  if (!holds) grasped_ = false;
  moving_ = answer_.has_value() || (phase_ == Phase::follow && !settled);
  const bool activates = phase_ == Phase::reset || phase_ == Phase::activate;
  if (!status.active && !activates && (command_.action & kActivate) != 0) {
    command_ = {};  // no command that activates it, since its fingers then move
    phase_ = Phase::idle;
    max_width_ = 0;
    moving_ = false;
    return finish(false, "it was reset: home it");
  }
  if (answer_ && host_now() > until_) {
    halt();
    return finish(false, "its motion did not end in time, and was stopped");
  }
  if (phase_ > Phase::activate && (is_command || phase_ == Phase::follow) && status.fault >= kFirstFailure) {
    halt();
    return finish(false, fault());
  }
  // Not at each change by a single step, which what is held may do.
  if (const int to = next();
      phase_ > Phase::activate && !settled && (to == goal_ || std::abs(to - command_.position) > reach_ / 4))
    command_.position = static_cast<unsigned char>(to);
  switch (phase_) {
    case Phase::idle:
      return;
    case Phase::reset:
      if (!is_command || status.active) return;
      command_.action = kActivate;
      phase_ = Phase::activate;
      return;
    case Phase::activate:
      if (!is_command || !status.active) return;
      phase_ = Phase::find_closed;
      go(kFull, model_.slowest + (model_.fastest - model_.slowest) / 4, model_.weakest);
      return;
    case Phase::find_closed:
      if (!settled) return;
      closed_ = status.position;
      phase_ = Phase::find_open;
      go(0, model_.slowest + (model_.fastest - model_.slowest) / 4, model_.weakest);
      return;
    case Phase::find_open:
      if (!settled) return;
      open_ = status.position;
      phase_ = Phase::idle;
      if (closed_ - open_ < kFull / 2.0) {
        open_ = 3;
        closed_ = 230;
        return finish(false, "something was between the fingers: remove it, then home again");
      }
      max_width_ = model_.stroke;
      return finish(true);
    case Phase::move:
      if (!settled) return;
      phase_ = Phase::idle;
      return finish(status.object == 3, "the width was not reached: something is in its way");
    case Phase::grasp: {
      if (!settled) return;
      const bool fits =
          grasp_.width - grasp_.tolerance_inner < width_ && width_ < grasp_.width + grasp_.tolerance_outer;
      grasped_ = fits;
      phase_ = Phase::idle;
      if (!fits) command_.action = kActivate;
      return finish(fits, "nothing of that width was grasped");
    }
    case Phase::follow:
      if (settled && status.object == 2) grasped_ = true;
      if (host_now() < until_) return;
      halt();
  }
}

void Robotiq::go(double position, double speed, double force) {
  goal_ = static_cast<int>(std::clamp(std::lround(position), 0L, long{kFull}));
  reach_ = std::max(1, static_cast<int>(kAhead * speed * (closed_ - open_) / model_.stroke));
  command_ = {kActivate | kGo, static_cast<unsigned char>(next()),
              portion(speed, model_.slowest, model_.fastest), portion(force, model_.weakest, model_.firmest)};
}

// The position to write on the way to the goal. At the ends of its fingers it reports to be at its target,
// before it is.
int Robotiq::next() const {
  const int from = last_.goes && last_.object == 3 ? last_.echo : last_.position;
  return std::clamp(goal_, from - reach_, from + reach_);
}

// Ends the motion where it is, that of the activation too. What it holds stays held.
void Robotiq::halt() {
  if (phase_ == Phase::reset || phase_ == Phase::activate)
    command_ = {};
  else if (phase_ != Phase::idle && !grasped_)
    command_.action &= static_cast<unsigned char>(~kGo);
  phase_ = Phase::idle;
}

// Why it cannot move so; empty: it can.
std::string Robotiq::impossible(double speed, double force) const {
  std::array<char, 128> why{};
  if (speed < model_.slowest || speed > model_.fastest)
    (void)std::snprintf(why.data(), why.size(), " cannot move at %g m/s: %g to %g m/s are possible", speed,
                        model_.slowest, model_.fastest);
  else if (force < model_.weakest || force > model_.firmest)
    (void)std::snprintf(why.data(), why.size(), " cannot press with %g N: %g to %g N are possible", force,
                        model_.weakest, model_.firmest);
  return why[0] == 0 ? std::string{} : who_ + why.data();
}

void Robotiq::finish(bool success, std::string why) {
  if (!answer_) return;
  answer_->set_value({.success = success, .reason = success ? std::string{} : who_ + ": " + why});
  answer_.reset();
  moving_ = false;
}

std::future<RequestAnswer> Robotiq::request(const GripperRequest& request) {
  const std::lock_guard lock(mutex_);
  news_ = true;
  asked_.notify_all();
  const auto* follow = std::get_if<GripperFollow>(&request);
  const bool holds = follow != nullptr && !follow->width;
  if (holds && phase_ == Phase::follow) halt();
  if (std::holds_alternative<GripperStop>(request)) {
    finish(false, "its motion was ended by a stop");
    halt();
    command_.action &= static_cast<unsigned char>(~kGo);
    if (present_) return answer_now({.success = true, .reason = {}});
  }
  if (!present_)
    return refuse_request(who_ +
                          " does not answer: a stop is sent nevertheless; look at its supply "
                          "and cable, and restart the run if its port was gone");
  if (auto why = check(request); !why.empty()) return refuse_request(std::move(why));
  if (follow != nullptr) {
    if (auto why = impossible(follow->speed, follow->force); !holds && !why.empty())
      return refuse_request(std::move(why));
    if (answer_ || holds) return answer_now({.success = true, .reason = {}});
  }
  const bool homes = std::holds_alternative<GripperHoming>(request);
  if (!homes && (!last_.active || max_width_ == 0))
    return refuse_request(who_ + " has to be homed first; its fingers then close and open fully");
  if (follow != nullptr) {
    if (last_.fault >= kFirstFailure) return refuse_request(who_ + ": " + fault());
    until_ = after(follow->silence);
    if (!(grasped_ && *follow->width < width_ + kFollowed)) {
      go(position_of(*follow->width), follow->speed, follow->force);
      grasped_ = false;
    }
    phase_ = Phase::follow;
    return answer_now({.success = true, .reason = {}});
  }
  const auto* move = std::get_if<GripperMove>(&request);
  const auto* grasp = std::get_if<GripperGrasp>(&request);
  if (!homes && move == nullptr && grasp == nullptr)
    return refuse_request(who_ + " has fingers and no suction");
  if (grasp != nullptr && grasped_)
    return refuse_request(who_ + " holds something already, and is left as it is");
  if (auto why = move != nullptr    ? impossible(move->speed, model_.weakest)
                 : grasp != nullptr ? impossible(grasp->speed, grasp->force)
                                    : std::string{};
      !why.empty())
    return refuse_request(std::move(why));
  finish(false, "its motion was ended by another motion");
  answer_.emplace();
  until_ = after(homes ? kHoming : kMotion);
  if (homes) {
    command_ = {};
    max_width_ = 0;
    phase_ = Phase::reset;
  } else if (move != nullptr) {
    go(position_of(move->width), move->speed, model_.weakest);
    phase_ = Phase::move;
  } else {
    grasp_ = *grasp;
    go(kFull, grasp->speed, grasp->force);
    phase_ = Phase::grasp;
  }
  moving_ = true;
  grasped_ = false;
  return answer_->get_future();
}

}  // namespace
}  // namespace robotiq

std::unique_ptr<EndEffector> robotiq_link(const std::string& name, const std::string& port,
                                          const std::string& model) {
  return std::make_unique<robotiq::Robotiq>(name, port, model);
}

}  // namespace multipanda::fci
