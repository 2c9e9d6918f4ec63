#include "fci/client/end_effector_connection.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "fci/wire/gripper.hpp"

namespace multipanda::fci {
namespace {

constexpr double kTimeout = 1.0;      // for immediate replies [s]
constexpr double kSmallStep = 0.002;  // of a followed width [m]
constexpr double kStale = 0.5;        // without a state [s]; a hand sends several in this time

HostTime after(double seconds) {
  return host_now() + std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * seconds));
}

RequestAnswer answer_of(GripperStatus status, bool vacuum) {
  switch (status) {
    case GripperStatus::success:
      return {.success = true, .reason = {}};
    case GripperStatus::unsuccessful:
      return {.success = false,
              .reason = vacuum ? "the vacuum gripper did not succeed in time: nothing was picked up, or "
                                 "what it held was not released"
                               : "the gripper motion did not succeed: nothing of that width was "
                                 "grasped, or the width was not reached"};
    case GripperStatus::aborted:
      return {.success = false, .reason = "the gripper's motion was ended by a stop or by another motion"};
    case GripperStatus::fail:
      break;
  }
  return {.success = false,
          .reason =
              "the gripper failed: check its light and the arm's messages; it needs homing after its fingers "
              "were changed"};
}

}  // namespace

EndEffectorConnection::EndEffectorConnection(std::string who, std::string address, std::uint16_t port,
                                             std::unique_ptr<EndEffectorProtocol> protocol)
    : who_(std::move(who)),
      address_(std::move(address)),
      port_(port),
      protocol_(std::move(protocol)),
      channel_(HeaderKind::gripper, who_) {
  udp_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  wake_ = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  sockaddr_in any{};
  any.sin_family = AF_INET;
  if (udp_ < 0 || wake_ < 0 || ::bind(udp_, reinterpret_cast<const sockaddr*>(&any), sizeof any) != 0) {
    const int error = errno;
    if (udp_ >= 0) ::close(udp_);
    if (wake_ >= 0) ::close(wake_);
    throw std::system_error(error, std::system_category(), who_ + ": no UDP socket");
  }
}

EndEffectorConnection::~EndEffectorConnection() {
  disconnect("the program ends");
  ::close(udp_);
  ::close(wake_);
}

// Ends the thread and the connection, and answers the running requests.
void EndEffectorConnection::disconnect(const std::string& why) {
  ending_ = true;
  const std::uint64_t one = 1;
  (void)!::write(wake_, &one, sizeof one);
  if (thread_.joinable()) thread_.join();
  const std::lock_guard lock(mutex_);
  channel_.close();
  connected_ = false;
  present_ = moving_ = false;
  for (Request& request : running_) request.answer.set_value({.success = false, .reason = who_ + ": " + why});
  running_.clear();
}

void EndEffectorConnection::connect() {
  disconnect("it is being reconnected");
  sockaddr_in here{};
  socklen_t size = sizeof here;
  ::getsockname(udp_, reinterpret_cast<sockaddr*>(&here), &size);
  // Without the mutex: the channel is unused until `connected_`, and requests, which may soon include a stop,
  // are refused at once meanwhile.
  channel_.connect(address_, port_, kTimeout);
  std::array<std::byte, kGripperConnectReplySize> bytes{};
  const std::uint32_t id = channel_.next_id();
  (void)encode_gripper_request(id, GripperConnectRequest{protocol_->version(), ntohs(here.sin_port)}, bytes);
  channel_.send(bytes, kTimeout);
  const TcpChannel::Reply reply = channel_.wait(id, kTimeout, "Connect");
  GripperStatus status{};
  std::uint16_t version = 0;
  const bool is_reply = decode_gripper_connect_reply(reply.payload, status, version) == WireResult::ok;
  if (!is_reply || status != GripperStatus::success) {
    channel_.close();
    throw ConnectionError(is_reply ? ConnectionError::Kind::incompatible : ConnectionError::Kind::protocol,
                          who_ + " has version " + std::to_string(version) +
                              " of its protocol; supported: " + std::to_string(protocol_->version()));
  }
  {
    const std::lock_guard lock(mutex_);
    number_ = 0;
    state_ns_ = 0;
    order_.reset();
    following_.reset();
    connected_ = true;
  }
  present_ = true;
  ending_ = false;
  thread_ = std::thread([this] { run(); });
}

// The reason if it cannot begin; empty: it runs.
std::string EndEffectorConnection::begin(const GripperRequest& request, Request entry) {
  std::string why;
  entry.message.resize(64);
  entry.command_id = channel_.next_id();
  entry.message.resize(protocol_->encode(request, entry.command_id, entry.message, why));
  if (!why.empty()) return why;
  if (entry.message.empty())
    return who_ + (is_vacuum() ? " is a vacuum gripper" : " is a gripper with fingers") +
           " and does not support this request";
  entry.give_up = after(protocol_->patience_s(request));
  try {
    constexpr double kAtOnce = 0;  // the sender may have to pass on a stop of the arms next
    channel_.send(entry.message, kAtOnce);
  } catch (const ConnectionError& error) {
    if (error.is_fatal()) present_ = false;  // run() also notices, and answers the other pending requests
    return error.what();
  }
  running_.push_back(std::move(entry));
  moving_ = true;
  const std::uint64_t one = 1;
  (void)!::write(wake_, &one, sizeof one);
  return {};
}

std::future<RequestAnswer> EndEffectorConnection::request(const GripperRequest& request) {
  const std::lock_guard lock(mutex_);
  if (!connected_) return refuse_request(who_ + " is not connected: reconnect the arm");
  if (const auto* desired = std::get_if<GripperFollow>(&request); desired != nullptr && !is_vacuum()) {
    if (auto why = check(request); !why.empty()) return refuse_request(std::move(why));
    if (!following_ && !desired->width) return answer_now({.success = true, .reason = {}});
    if (desired->width && is_stale())
      return refuse_request(who_ +
                            " cannot follow widths: its states (UDP) do not arrive; check the firewall and "
                            "reconnect the arm");
    if (!following_) {
      sent_width_ = width_;
      blocked_ = false;
      failed_.clear();
    }
    if (desired->width && !failed_.empty()) return refuse_request(std::exchange(failed_, {}));
    if (desired->width) following_ = *desired;
    follow_until_ = after(desired->width ? desired->silence : 0);
    const std::uint64_t one = 1;
    (void)!::write(wake_, &one, sizeof one);
    return answer_now({.success = true, .reason = {}});
  }
  Request entry;
  auto future = entry.answer.get_future();
  if (std::holds_alternative<GripperStop>(request)) following_.reset();  // even if it cannot be sent
  std::string why = begin(request, std::move(entry));
  if (!why.empty()) return refuse_request(std::move(why));
  following_.reset();
  return future;
}

bool EndEffectorConnection::is_stale() const {
  return host_now().ns > state_ns_ + static_cast<std::int64_t>(1e9 * kStale);
}

// Ends the following, and its motion. With the mutex.
void EndEffectorConnection::hold() {
  const double speed = following_->speed;
  following_.reset();
  if (running_.empty() || !running_.back().follows) return;
  const bool grasps = running_.back().grasps;
  if (grasps && grasped_) return;
  if (grasps || is_stale()) {
    (void)begin(GripperStop{}, {});
  } else {
    (void)begin(GripperMove{width_, speed}, {.follows = true});
  }
}

// The next move to the newest width, if one is due. With the mutex.
void EndEffectorConnection::follow() {
  if (!following_) return;
  if (host_now() >= follow_until_ || is_stale()) return hold();
  if (!running_.empty()) return;
  const double width = width_, most = max_width_;
  const double to = most > 0 ? std::min(*following_->width, most) : *following_->width;
  if (grasped_ && to < width + kSmallStep) return;
  std::string why;
  if (blocked_ && to <= sent_width_ && width > to + kSmallStep) {
    blocked_ = false;
    why = begin(GripperGrasp{.width = width,
                             .speed = following_->speed,
                             .force = following_->force,
                             .tolerance_inner = 1,
                             .tolerance_outer = 1},
                {.follows = true, .grasps = true});
  } else if (std::abs(to - sent_width_) >= kSmallStep) {
    sent_width_ = to;
    blocked_ = false;
    why = begin(GripperMove{to, following_->speed}, {.follows = true});
  }
  if (!why.empty()) following_.reset();
}

void EndEffectorConnection::run() {
  std::string lost;
  while (!ending_ && lost.empty()) {
    const int tcp = [this] {
      const std::lock_guard lock(mutex_);
      return channel_.file();
    }();
    std::array<pollfd, 3> files{pollfd{tcp, POLLIN, 0}, pollfd{udp_, POLLIN, 0}, pollfd{wake_, POLLIN, 0}};
    constexpr int kLookMs = 100, kFollowMs = 10;  // interval for detecting expired requests, and silence
    const bool follows = [this] {
      const std::lock_guard lock(mutex_);
      return following_.has_value();
    }();
    (void)::poll(files.data(), files.size(), follows ? kFollowMs : kLookMs);
    std::uint64_t count = 0;
    (void)!::read(wake_, &count, sizeof count);
    read_states();
    const std::lock_guard lock(mutex_);
    try {
      if (!channel_.is_open())
        throw ConnectionError(ConnectionError::Kind::lost, "the connection is lost: reconnect");
      channel_.read_available();
      answer_requests();
      follow();
    } catch (const ConnectionError& error) {
      lost = error.what();
    }
  }
  if (lost.empty()) return;
  const std::lock_guard lock(mutex_);
  channel_.close();
  connected_ = false;
  present_ = moving_ = false;
  for (Request& request : running_) request.answer.set_value({.success = false, .reason = lost});
  running_.clear();
}

void EndEffectorConnection::answer_requests() {
  const HostTime now = host_now();
  std::erase_if(running_, [&](Request& request) {
    if (const auto reply = channel_.take(request.command_id)) {
      GripperStatus status{};
      if (decode_gripper_reply(reply->payload, status) != WireResult::ok) {
        throw ConnectionError(ConnectionError::Kind::protocol, who_ + " sent an invalid reply");
      }
      RequestAnswer answer = answer_of(status, protocol_->is_vacuum());
      if (request.follows && !request.grasps) blocked_ = status == GripperStatus::unsuccessful;
      if (request.follows && status == GripperStatus::fail) failed_ = who_ + ": " + answer.reason;
      request.answer.set_value(std::move(answer));
      return true;
    }
    if (now < request.give_up) return false;
    throw ConnectionError(ConnectionError::Kind::timeout,
                          who_ + " has not answered for longer than the motion can take: reconnect");
  });
  moving_ = !running_.empty();
}

void EndEffectorConnection::read_states() {
  std::array<std::byte, 256> datagram;
  while (true) {
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const auto count =
        ::recvfrom(udp_, datagram.data(), datagram.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
    if (count < 0) return;
    if (from.sin_addr.s_addr != channel_.peer_address()) continue;
    multipanda::GripperState state;
    const std::uint32_t number =
        protocol_->decode_state(std::span(datagram).first(static_cast<std::size_t>(count)), state);
    if (order_.take(number, from.sin_port) != DatagramOrder::Taken::newest) continue;
    width_.store(state.width, std::memory_order_relaxed);
    max_width_.store(state.max_width, std::memory_order_relaxed);
    grasped_.store(state.grasped, std::memory_order_relaxed);
    state_ns_.store(host_now().ns, std::memory_order_relaxed);
    number_.store(number, std::memory_order_release);
  }
}

multipanda::GripperState EndEffectorConnection::state() const noexcept {
  return {.present = present_.load(std::memory_order_relaxed),
          .width = width_.load(std::memory_order_relaxed),
          .max_width = max_width_.load(std::memory_order_relaxed),
          .grasped = grasped_.load(std::memory_order_relaxed),
          .moving = moving_.load(std::memory_order_relaxed)};
}

}  // namespace multipanda::fci
