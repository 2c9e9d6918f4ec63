#include "fci/client/testing/fake_arm.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdexcept>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace multipanda::fci {
namespace {

int bound(int type, const std::string& address, std::uint16_t port, std::uint16_t& number) {
  const int file = ::socket(AF_INET, type | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(port);
  ::inet_pton(AF_INET, address.c_str(), &at.sin_addr);
  socklen_t size = sizeof(at);
  if (file < 0 || ::bind(file, reinterpret_cast<const sockaddr*>(&at), sizeof(at)) != 0 ||
      ::getsockname(file, reinterpret_cast<sockaddr*>(&at), &size) != 0) {
    throw std::runtime_error("the fake arm has no socket");
  }
  number = ntohs(at.sin_port);
  return file;
}

// Column-major 4x4.
std::array<double, 16> product(const std::array<double, 16>& a, const std::array<double, 16>& b) {
  std::array<double, 16> c{};
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t j = 0; j < 4; ++j) {
      for (std::size_t k = 0; k < 4; ++k) c[4 * j + i] += a[4 * k + i] * b[4 * j + k];
    }
  }
  return c;
}

constexpr std::array<double, 16> kIdentity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

}  // namespace

FakeArm::FakeArm(int version, std::string address)
    : dialect_(dialect(static_cast<std::uint16_t>(version))), address_(std::move(address)) {
  state_.robot_mode = static_cast<std::uint8_t>(RobotMode::idle);
  state_.control_command_success_rate = 1;
  for (auto* T : {&state_.O_T_EE, &state_.O_T_EE_d, &state_.O_T_EE_c, &state_.F_T_EE, &state_.EE_T_K,
                  &state_.F_T_NE, &state_.NE_T_EE}) {
    *T = kIdentity;
  }
  state_.q = {0, -0.7853981633974483, 0, -2.356194490192345, 0, 1.5707963267948966, 0.7853981633974483};
  listen_ = bound(SOCK_STREAM, address_, 0, port_);
  (void)::listen(listen_, 4);
  std::uint16_t any = 0;
  udp_ = bound(SOCK_DGRAM, address_, 0, any);
  thread_ = std::thread([this] { run(); });
}

FakeArm::~FakeArm() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  thread_.join();
  if (client_ >= 0) ::close(client_);
  ::close(listen_);
  ::close(udp_);
}

void FakeArm::run() {
  while (true) {
    int client = -1;
    {
      const std::lock_guard lock(mutex_);
      if (ending_) return;
      client = client_;
    }
    std::array<pollfd, 2> watched{
        {{.fd = listen_, .events = POLLIN, .revents = 0}, {.fd = client, .events = POLLIN, .revents = 0}}};
    (void)::poll(watched.data(), watched.size(), 1);
    const std::lock_guard lock(mutex_);
    // A new connection may get the descriptor of the one that it replaces, whose event is then void.
    if (watched[0].revents != 0) {
      accept_client();
    } else if (client_ >= 0 && client_ == client && watched[1].revents != 0) {
      std::array<std::byte, 4096> chunk;
      const ssize_t n = ::recv(client_, chunk.data(), chunk.size(), MSG_DONTWAIT);
      if (n <= 0) {
        drop_client();
      } else {
        inbox_.insert(inbox_.end(), chunk.begin(), chunk.begin() + n);
      }
    }
    while (inbox_.size() >= kArmHeader) {
      MessageHeader header;
      (void)decode(HeaderKind::arm, std::span(inbox_).first(kArmHeader), header);
      if (header.size < kArmHeader || inbox_.size() < header.size) break;
      const std::vector<std::byte> message(inbox_.begin(), inbox_.begin() + header.size);
      inbox_.erase(inbox_.begin(), inbox_.begin() + header.size);
      serve(header, std::span(message).subspan(kArmHeader));
    }
    if (automatic_ && to_.sin_port != 0) publish_locked(++id_);
  }
}

void FakeArm::accept_client() {
  drop_client();
  sockaddr_in from{};
  socklen_t size = sizeof(from);
  client_ = ::accept(listen_, reinterpret_cast<sockaddr*>(&from), &size);
  if (skip_ == 0 && closing_ > 0) {
    --closing_;
    return drop_client();
  }
  skip_ = std::max(0, skip_ - 1);
  const int on = 1;
  (void)::setsockopt(client_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  to_ = from;
  to_.sin_port = 0;  // set by Connect
}

void FakeArm::drop_client() {
  if (client_ >= 0) ::close(client_);
  client_ = -1;
  to_.sin_port = 0;
  inbox_.clear();
  held_back_.clear();
  if (motion_id_) {
    state_.motion_generator_mode = 0;
    state_.controller_mode = static_cast<std::uint8_t>(ControllerMode::other);
    state_.robot_mode = static_cast<std::uint8_t>(RobotMode::idle);
  }
  motion_id_.reset();
}

void FakeArm::write(const std::vector<std::byte>& bytes) {
  if (client_ >= 0) (void)::send(client_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
}

void FakeArm::reply(Command command, std::uint32_t id, Status status, std::span<const std::byte> more) {
  std::vector<std::byte> bytes(kArmHeader + 1);
  (void)encode_reply(*dialect_, command, id, status, bytes, more.size());
  bytes.insert(bytes.end(), more.begin(), more.end());
  if (in_pairs_ && held_back_.empty()) {
    held_back_ = std::move(bytes);
    return;
  }
  write(bytes);
  write(held_back_);
  held_back_.clear();
}

void FakeArm::serve(const MessageHeader& header, std::span<const std::byte> payload) {
  const auto command = command_of(*dialect_, header.command);
  if (!command) return drop_client();
  asked_.push_back({*command, header.command_id, {payload.begin(), payload.end()}});
  if (withheld_.contains(*command)) return;
  const auto told = answers_.find(*command);
  Status status = told != answers_.end() ? told->second : Status::success;
  std::vector<std::byte> more;
  switch (*command) {
    case Command::connect: {
      ConnectRequest request;
      (void)decode_request(*dialect_, payload, request);
      std::vector<std::byte> bytes(kArmHeader + 3);
      const bool same = request.version == dialect_->version;
      (void)encode_connect_reply(header.command_id, same ? status : Status::incompatible_version,
                                 dialect_->version, bytes);
      write(bytes);
      if (same) to_.sin_port = htons(request.udp_port);
      if (same && !automatic_) publish_locked(++id_);
      return;
    }
    case Command::move: {
      MoveRequest request;
      if (decode_request(*dialect_, payload, request) != WireResult::ok) status = Status::invalid_argument;
      if (status == Status::success) {
        status = Status::motion_started;
        motion_id_ = header.command_id;
        state_.motion_generator_mode = static_cast<std::uint8_t>(published(request.generator));
        state_.controller_mode = static_cast<std::uint8_t>(published(request.controller));
        state_.robot_mode = static_cast<std::uint8_t>(RobotMode::move);
      }
      break;
    }
    case Command::stop_move:
      if (motion_id_) {
        const std::uint32_t id = *motion_id_;
        motion_id_.reset();
        if (ends_late_) {
          late_ends_.push_back(id);
        } else {
          reply(Command::move, id, Status::preempted);
        }
        state_.motion_generator_mode = 0;
        state_.controller_mode = static_cast<std::uint8_t>(ControllerMode::other);
        state_.robot_mode = static_cast<std::uint8_t>(RobotMode::idle);
      }
      break;
    case Command::automatic_error_recovery:
      if (status == Status::success) {
        state_.errors.fill(0);
        state_.robot_mode = static_cast<std::uint8_t>(RobotMode::idle);
      }
      break;
    case Command::set_ne_to_ee: {
      SetNEToEERequest request;
      (void)decode_request(*dialect_, payload, request);
      state_.NE_T_EE = request.NE_T_EE;
      state_.F_T_EE = product(state_.F_T_NE, state_.NE_T_EE);
      break;
    }
    case Command::set_ee_to_k: {
      SetEEToKRequest request;
      (void)decode_request(*dialect_, payload, request);
      state_.EE_T_K = request.EE_T_K;
      break;
    }
    case Command::set_load: {
      SetLoadRequest request;
      (void)decode_request(*dialect_, payload, request);
      state_.m_load = request.m_load;
      state_.F_x_Cload = request.F_x_Cload;
      state_.I_load = request.I_load;
      break;
    }
    case Command::get_robot_model:
    case Command::load_model_library:
      for (const char c : model_) more.push_back(static_cast<std::byte>(c));
      break;
    case Command::get_cartesian_limit: {
      more.resize(153);
      CartesianLimit limit;
      limit.object_p_max = {0.1, 0.2, 0.3};
      limit.object_frame = kIdentity;
      limit.object_activation = true;
      (void)encode(*dialect_, limit, more);
      break;
    }
    default:
      break;
  }
  reply(*command, header.command_id, status, more);
  if (*command != Command::stop_move) {
    for (const std::uint32_t id : std::exchange(late_ends_, {})) reply(Command::move, id, Status::preempted);
  }
  if (!automatic_ && to_.sin_port != 0) publish_locked(++id_);
}

void FakeArm::answer(Command command, Status status) {
  const std::lock_guard lock(mutex_);
  answers_[command] = status;
}
void FakeArm::withhold(Command command) {
  const std::lock_guard lock(mutex_);
  withheld_.insert(command);
}
void FakeArm::release(Command command) {
  const std::lock_guard lock(mutex_);
  withheld_.erase(command);
  const Asked last = asked_.back();  // serve() stores it again
  serve({.command = command_id(*dialect_, last.command).value(), .command_id = last.command_id},
        last.payload);
}
void FakeArm::hang_up_on(int first, int count) {
  const std::lock_guard lock(mutex_);
  skip_ = first;
  closing_ = count;
}
void FakeArm::report_ends_late() {
  const std::lock_guard lock(mutex_);
  ends_late_ = true;
}
void FakeArm::answer_in_pairs() {
  const std::lock_guard lock(mutex_);
  in_pairs_ = true;
}
void FakeArm::change(const std::function<void(RobotState&)>& change) {
  const std::lock_guard lock(mutex_);
  change(state_);
}
void FakeArm::set_model(std::string urdf) {
  const std::lock_guard lock(mutex_);
  model_ = std::move(urdf);
}
void FakeArm::set_automatic(bool on) {
  const std::lock_guard lock(mutex_);
  automatic_ = on;
}
void FakeArm::send_bytes(const std::vector<std::byte>& bytes) {
  const std::lock_guard lock(mutex_);
  write(bytes);
}
void FakeArm::hang_up() {
  const std::lock_guard lock(mutex_);
  drop_client();
}

void FakeArm::end_motion(Status status, RobotMode mode, std::size_t error) {
  const std::lock_guard lock(mutex_);
  if (!motion_id_) throw std::runtime_error("no motion runs");
  state_.motion_generator_mode = 0;
  state_.controller_mode = static_cast<std::uint8_t>(ControllerMode::other);
  state_.robot_mode = static_cast<std::uint8_t>(mode);
  if (error < kErrorCount) state_.errors[error] = state_.reflex_reason[error] = 1;
  const std::uint32_t id = *motion_id_;
  motion_id_.reset();
  if (!automatic_) publish_locked(++id_);
  reply(Command::move, id, status);
}

std::vector<FakeArm::Asked> FakeArm::asked() const {
  const std::lock_guard lock(mutex_);
  return asked_;
}

std::uint64_t FakeArm::publish(std::uint64_t skip) {
  const std::lock_guard lock(mutex_);
  id_ += skip + 1;
  publish_locked(id_);
  return id_;
}
void FakeArm::publish_number(std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  publish_locked(id);
}

std::vector<std::byte> FakeArm::state_with(std::uint64_t id) const {
  const std::lock_guard lock(mutex_);
  RobotState state = state_;
  state.message_id = id;
  std::vector<std::byte> bytes(kMaxStateSize);
  bytes.resize(encode(*dialect_, state, bytes));
  return bytes;
}

void FakeArm::publish_locked(std::uint64_t id) {
  state_.message_id = id;
  std::array<std::byte, kMaxStateSize> bytes;
  const std::size_t size = encode(*dialect_, state_, bytes);
  (void)::sendto(udp_, bytes.data(), size, 0, reinterpret_cast<const sockaddr*>(&to_), sizeof(to_));
}

void FakeArm::send_datagram(const std::vector<std::byte>& datagram, const char* from_address) {
  sockaddr_in to{};
  {
    const std::lock_guard lock(mutex_);
    to = to_;
  }
  std::uint16_t any = 0;
  const int file = bound(SOCK_DGRAM, from_address, 0, any);
  (void)::sendto(file, datagram.data(), datagram.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                 sizeof(to));
  ::close(file);
}

std::optional<RobotCommand> FakeArm::command(double timeout_s) {
  pollfd watched{.fd = udp_, .events = POLLIN, .revents = 0};
  if (::poll(&watched, 1, static_cast<int>(timeout_s * 1e3)) <= 0) return std::nullopt;
  std::array<std::byte, 1024> bytes;
  const ssize_t n = ::recv(udp_, bytes.data(), bytes.size(), 0);
  RobotCommand command;
  if (n < 0 ||
      decode(*dialect_, std::span(bytes).first(static_cast<std::size_t>(n)), command) != WireResult::ok) {
    throw std::runtime_error("the received datagram is not a valid command");
  }
  return command;
}

std::size_t FakeArm::commands_waiting() {
  std::size_t count = 0;
  while (command(0)) ++count;
  return count;
}

}  // namespace multipanda::fci
