#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

// Where the sockets of running scenes stand, and who may use one.
namespace multipanda {

// A live process has this socket already.
struct SocketTaken : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// $XDG_RUNTIME_DIR/multipanda, else <temporary folder>/multipanda-<uid>.
std::filesystem::path socket_folder();

// Makes the folder (mode 0700) where it is missing. Throws std::runtime_error if it cannot be made, is a
// link, belongs to somebody else or is open to others: whoever can write there can move the arms.
void make_private_folder(const std::filesystem::path& folder);

// The sockets in a folder behind which a process listens, by name.
std::vector<std::filesystem::path> running_sockets(const std::filesystem::path& folder = socket_folder());

// Of a run's data stream beside its socket: "<path>.stream".
std::filesystem::path stream_path(const std::filesystem::path& socket);

// An address, or std::invalid_argument (Unix sockets' paths have at most 107 bytes).
void check_socket_path(const std::filesystem::path& path);

// Owns the path of a listening socket as long as it lives, by a lock on "<path>.lock" that the kernel drops
// with the process, however it ends. What a dead process left at the path is removed.
class SocketClaim {
 public:
  // Throws SocketTaken; std::runtime_error if the folder is missing or something else stands at the path.
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
// A connected socket; -1 and errno if nobody listens. Throws std::invalid_argument (path too long).
int connect_to(const std::filesystem::path& path, int type);

}  // namespace multipanda
