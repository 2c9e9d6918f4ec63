#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

// Paths and ownership of the sockets of running scenes.
namespace multipanda {

// Another live process has this socket.
struct SocketTaken : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// $XDG_RUNTIME_DIR/multipanda, otherwise /tmp/multipanda-<uid>.
std::filesystem::path socket_folder();

// Makes the folder (mode 0700) if it is missing. Throws std::runtime_error if it cannot be created, is a
// link, belongs to another user or is open to others: anyone with write access can move the arms.
void make_private_folder(const std::filesystem::path& folder);

// The sockets in a folder on which a process listens, sorted by name.
std::vector<std::filesystem::path> running_sockets(const std::filesystem::path& folder = socket_folder());

// Those of all runs on this computer: also of sockets elsewhere, of other environments and of other users.
std::vector<std::filesystem::path> all_running_sockets();

// Path of a run's data stream: "<path>.stream" next to its socket.
std::filesystem::path stream_path(const std::filesystem::path& socket);

// Throws std::invalid_argument for an invalid path (Unix sockets have paths of at most 107 bytes).
void check_socket_path(const std::filesystem::path& path);

// Owns the path of a listening socket by a lock on "<path>.lock", which the kernel releases when the process
// ends. The socket of a dead process is removed.
class SocketClaim {
 public:
  // Throws SocketTaken; std::runtime_error if the folder is missing or something else is at the path.
  explicit SocketClaim(std::filesystem::path path);
  ~SocketClaim();  // removes socket, stream socket and lock
  SocketClaim(const SocketClaim&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_, lock_path_;
  int lock_ = -1;
};

// A listening socket at a claimed path, mode 0600, non-blocking. `type`: SOCK_STREAM or SOCK_SEQPACKET.
// Throws std::system_error.
int listen_at(const std::filesystem::path& path, int type);
// A connected socket, or -1 with errno if no process listens, or none accepts for 2 s. Throws
// std::invalid_argument (path too long).
int connect_to(const std::filesystem::path& path, int type);

}  // namespace multipanda
