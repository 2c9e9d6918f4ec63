#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <condition_variable>
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
constexpr double kPeriod = 0.01;                       // of the exchange [s]
constexpr double kHoming = 60, kMotion = 30;           // [s]
constexpr double kFollowed = 0.002;                    // what is held stays held below this opening [m]
constexpr int kFull = 255;

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
            .grasped = grasped_,
            .moving = moving_};
  }

 private:
  enum class Phase : std::uint8_t { idle, reset, activate, find_closed, find_open, move, grasp, follow };
  struct Command {
    unsigned char action = 0, position = 0, speed = 0, force = 0;
    bool operator==(const Command&) const = default;
  };
  struct Status {
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
  void aim(double width, double speed, double force);
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
  Command command_, written_;
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
  finish(false, why);
  present_ = moving_ = grasped_ = false;
  if (file_ >= 0) ::close(file_);
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
  if (!status) return fail("it does not answer");
  {
    const std::lock_guard lock(mutex_);
    last_ = *status;
    // As it is: what it holds stays held, and nothing moves.
    const auto action =
        static_cast<unsigned char>((status->active ? kActivate : 0) | (status->goes ? kGo : 0));
    command_ = written_ = {action, static_cast<unsigned char>(status->echo), 0, 0};
    phase_ = Phase::idle;
    width_ = width_of(status->position);
  }
  present_ = true;
  ending_ = false;
  thread_ = std::thread([this] { run(); });
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
  return Status{.active = (r[0] >> 4u & 3u) == 3,
                .goes = (r[0] & kGo) != 0,
                .object = r[0] >> 6u,
                .fault = r[2] & 0x0F,
                .echo = r[3],
                .position = r[4]};
}

void Robotiq::run() {
  HostTime heard = host_now();
  while (!ending_) {
    std::unique_lock lock(mutex_);
    const Command desired = command_;
    const bool changed = desired != written_;
    news_ = false;
    lock.unlock();
    const bool wrote = changed && write(desired);
    const auto status = read();
    if (status) heard = host_now();
    lock.lock();
    if (wrote) {
      written_ = desired;
      turns_ = 0;
    }
    if (status) {
      ++turns_;
      turn(*status);
    }
    if (seconds(host_now() - heard) > kLost) {
      present_ = moving_ = grasped_ = false;
      return finish(false, "it no longer answers: look at its supply and cable, then reconnect the arm");
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
  const bool settled = is_command && status.echo == command_.position && status.object != 0;
  const bool holds = status.goes && status.object == 2 && (phase_ != Phase::move);
  if (!holds) grasped_ = false;
  moving_ = answer_.has_value() || (phase_ == Phase::follow && !settled);
  if (answer_ && host_now() > until_) {
    command_.action &= static_cast<unsigned char>(~kGo);
    phase_ = Phase::idle;
    return finish(false, "its motion did not end in time, and was stopped");
  }
  constexpr int kFirstFailure = 8;
  if (answer_ && is_command && phase_ > Phase::activate && status.fault >= kFirstFailure) {
    phase_ = Phase::idle;
    return finish(false,
                  "it reports fault " + std::to_string(status.fault) + ": see its manual, then home it");
  }
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
      command_ = {kActivate | kGo, kFull, kFull / 4, 0};
      return;
    case Phase::find_closed:
      if (!settled) return;
      closed_ = status.position;
      phase_ = Phase::find_open;
      command_.position = 0;
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
      if (!grasped_) command_.action = kActivate;  // stays where it is
      phase_ = Phase::idle;
  }
}

void Robotiq::aim(double width, double speed, double force) {
  const double position = closed_ - width / model_.stroke * (closed_ - open_);
  command_ = {kActivate | kGo, static_cast<unsigned char>(std::clamp(std::lround(position), 0L, long{kFull})),
              portion(speed, model_.slowest, model_.fastest), portion(force, model_.weakest, model_.firmest)};
}

void Robotiq::finish(bool success, std::string why) {
  if (!answer_) return;
  answer_->set_value({.success = success, .reason = success ? std::string{} : who_ + ": " + why});
  answer_.reset();
  moving_ = false;
}

std::future<RequestAnswer> Robotiq::request(const GripperRequest& request) {
  const std::lock_guard lock(mutex_);
  if (!present_) return refuse_request(who_ + " is not connected: reconnect the arm");
  if (auto why = check(request); !why.empty()) return refuse_request(std::move(why));
  news_ = true;
  asked_.notify_all();
  const auto* follow = std::get_if<GripperFollow>(&request);
  if (std::holds_alternative<GripperStop>(request)) {
    finish(false, "its motion was ended by a stop");
    command_.action &= static_cast<unsigned char>(~kGo);
    phase_ = Phase::idle;
    return answer_now({.success = true, .reason = {}});
  }
  if (follow != nullptr && (answer_ || !follow->width)) {
    if (!answer_ && phase_ == Phase::follow) until_ = {};
    return answer_now({.success = true, .reason = {}});
  }
  const bool homes = std::holds_alternative<GripperHoming>(request);
  if (!homes && !last_.active)
    return refuse_request(who_ + " has to be homed first; its fingers then close and open wholly");
  if (follow != nullptr) {
    until_ = after(follow->silence);
    if (!(grasped_ && *follow->width < width_ + kFollowed)) aim(*follow->width, follow->speed, follow->force);
    phase_ = Phase::follow;
    return answer_now({.success = true, .reason = {}});
  }
  const auto* move = std::get_if<GripperMove>(&request);
  const auto* grasp = std::get_if<GripperGrasp>(&request);
  if (!homes && move == nullptr && grasp == nullptr)
    return refuse_request(who_ + " has fingers and no suction");
  if (grasp != nullptr && grasped_)
    return refuse_request(who_ + " holds something already, and is left as it is");
  finish(false, "its motion was ended by another motion");
  answer_.emplace();
  until_ = after(homes ? kHoming : kMotion);
  if (homes) {
    command_ = {};
    phase_ = Phase::reset;
  } else if (move != nullptr) {
    aim(move->width, move->speed, model_.weakest);
    phase_ = Phase::move;
  } else {
    grasp_ = *grasp;
    aim(0, grasp->speed, grasp->force);
    command_.position = kFull;
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
