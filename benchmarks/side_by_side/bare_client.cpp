// The least that holds a Franka Research 3: sockets, and zero torques for every state. `bare_client ADDRESS`,
// until it is ended.
#include <arpa/inet.h>
#include <array>
#include <cstdio>
#include <cstring>
#include <netinet/in.h>
#include <sched.h>
#include <sys/socket.h>

#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"

using namespace multipanda::fci;

int main(int count, char** words) {
  constexpr Dialect d = *dialect(kNewestVersion);
  std::array<std::byte, kMaxStateSize> bytes{};
  sockaddr_in arm{}, own{};
  arm.sin_family = own.sin_family = AF_INET;
  arm.sin_port = htons(kArmPort);
  const auto at = [](sockaddr_in& a) { return reinterpret_cast<sockaddr*>(&a); };
  socklen_t size = sizeof(own);
  const int tcp = ::socket(AF_INET, SOCK_STREAM, 0), udp = ::socket(AF_INET, SOCK_DGRAM, 0);
  if (count != 2 || inet_pton(AF_INET, words[1], &arm.sin_addr) != 1 ||
      ::connect(tcp, at(arm), sizeof(arm)) != 0 || ::bind(udp, at(own), sizeof(own)) != 0 ||
      ::getsockname(udp, at(own), &size) != 0) {
    std::perror("bare_client ADDRESS: no arm there");
    return 1;
  }
  // The status is the first byte after the header; a bare client trusts that nothing else comes.
  auto ask = [&, id = 0U](const auto& request, std::ptrdiff_t reply, Status expected) mutable {
    const std::size_t length = encode_request(d, id++, request, bytes);
    return ::send(tcp, bytes.data(), length, 0) > 0 &&
           ::recv(tcp, bytes.data(), static_cast<std::size_t>(reply), MSG_WAITALL) == reply &&
           bytes[kArmHeader] == static_cast<std::byte>(expected);
  };
  if (!ask(ConnectRequest{d.version, ntohs(own.sin_port)}, kArmHeader + 3, Status::success) ||
      !ask(MoveRequest{}, kArmHeader + 1, Status::motion_started)) {
    std::fputs("bare_client: the arm refuses to connect or to move\n", stderr);
    return 1;
  }
  const sched_param highest{.sched_priority = 99};  // as its peers request, where permitted
  (void)::sched_setscheduler(0, SCHED_FIFO, &highest);
  RobotCommand command;
  std::array<std::byte, kMaxCommandSize> answer{};
  const std::size_t length = encode(d, command, answer);
  for (;;) {  // the answer names the state's message_id, the first field of both
    size = sizeof(arm);
    if (::recvfrom(udp, bytes.data(), bytes.size(), 0, at(arm), &size) < 0) return 1;
    if (bytes[state_offset(d, "controller_mode")] != static_cast<std::byte>(ControllerMode::external))
      continue;
    std::memcpy(answer.data(), bytes.data(), sizeof(command.message_id));
    ::sendto(udp, answer.data(), length, 0, at(arm), size);
  }
}
