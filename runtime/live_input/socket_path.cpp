#include "runtime/live_input/socket_path.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <set>
#include <sstream>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <system_error>
#include <unistd.h>

namespace multipanda {
namespace {

constexpr int kMostInLine = 128;  // who wait to be accepted; the server takes them all in a turn

std::filesystem::path beside(const std::filesystem::path& path, const char* suffix) {
  std::filesystem::path other = path;
  other += suffix;
  return other;
}

sockaddr_un address_of(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string text = path.string();
  if (text.empty() || text.size() >= sizeof(address.sun_path)) {
    throw std::invalid_argument("'" + text + "' cannot be a socket: expected a path of 1 to " +
                                std::to_string(sizeof(address.sun_path) - 1) + " bytes, found " +
                                std::to_string(text.size()));
  }
  std::memcpy(address.sun_path, text.data(), text.size());
  return address;
}

// Removes the socket of a dead process, and nothing else.
void remove_socket(const std::filesystem::path& path) {
  struct stat info {};
  if (lstat(path.c_str(), &info) != 0) return;
  if (!S_ISSOCK(info.st_mode)) {
    throw std::runtime_error("'" + path.string() +
                             "' exists and is not a socket; remove it or choose another path");
  }
  (void)unlink(path.c_str());
}

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

std::filesystem::path socket_folder() {
  if (const char* runtime = std::getenv("XDG_RUNTIME_DIR"); runtime != nullptr && *runtime == '/') {
    return std::filesystem::path(runtime) / "multipanda";
  }
  return std::filesystem::path("/tmp") / ("multipanda-" + std::to_string(getuid()));
}

void make_private_folder(const std::filesystem::path& folder) {
  if (mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) {
    throw std::runtime_error("the folder " + folder.string() + " cannot be created: " + std::strerror(errno));
  }
  struct stat info {};
  if (lstat(folder.c_str(), &info) != 0 || !S_ISDIR(info.st_mode)) {
    throw std::runtime_error(folder.string() + " is not a folder; remove it");
  }
  if (info.st_uid != getuid() || (info.st_mode & 077) != 0) {
    throw std::runtime_error("the folder " + folder.string() +
                             " must belong to this user and be closed to others (chmod 700): anyone with "
                             "write access can move the arms");
  }
}

// Without waiting: a frozen run, which accepts no connection, listens as well.
bool listens(const std::filesystem::path& path) {
  const sockaddr_un address = address_of(path);
  const int file = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (file < 0) return false;
  const bool found =
      connect(file, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0 || errno == EAGAIN;
  close(file);
  return found;
}

std::vector<std::filesystem::path> running_sockets(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> found;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    if (entry.path().extension() != ".sock" || !entry.is_socket(ignored)) continue;
    if (listens(entry.path())) found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

// A run has two listening sockets, with names that belong together.
std::vector<std::filesystem::path> all_running_sockets() {
  constexpr const char *kListens = "00010000", *kStream = "0001", *kSequence = "0005";
  std::set<std::filesystem::path> streams, sequences;
  std::ifstream table("/proc/net/unix");
  for (std::string line; std::getline(table, line);) {
    std::istringstream words(line);
    std::string number, references, protocol, flags, type, state, inode, path;
    words >> number >> references >> protocol >> flags >> type >> state >> inode;
    std::getline(words >> std::ws, path);
    if (flags != kListens || !path.starts_with('/')) continue;
    if (type == kStream) streams.insert(path);
    if (type == kSequence) sequences.insert(path);
  }
  std::erase_if(streams, [&](const auto& path) { return !sequences.contains(stream_path(path)); });
  for (auto& path : running_sockets()) streams.insert(std::move(path));
  return {streams.begin(), streams.end()};
}

std::filesystem::path stream_path(const std::filesystem::path& socket) { return beside(socket, ".stream"); }

void check_socket_path(const std::filesystem::path& path) {
  (void)address_of(path);
  (void)address_of(stream_path(path));
}

SocketClaim::SocketClaim(std::filesystem::path path)
    : path_(std::move(path)), lock_path_(beside(path_, ".lock")) {
  check_socket_path(path_);
  for (;;) {
    lock_ = open(lock_path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (lock_ < 0) {
      throw std::runtime_error("cannot create a socket at '" + path_.string() + "': " + std::strerror(errno));
    }
    if (flock(lock_, LOCK_EX | LOCK_NB) != 0) {
      close(lock_);
      throw SocketTaken(
          "'" + path_.string() +
          "' belongs to a running process; choose another path with --socket, or stop that run");
    }
    // The previous owner removes its lock file: check that the locked file is still the one at the path.
    struct stat locked {
    }, present{};
    if (fstat(lock_, &locked) == 0 && stat(lock_path_.c_str(), &present) == 0 &&
        locked.st_ino == present.st_ino && locked.st_dev == present.st_dev) {
      break;
    }
    close(lock_);
  }
  try {
    remove_socket(path_);
    remove_socket(stream_path(path_));
  } catch (...) {
    (void)unlink(lock_path_.c_str());
    close(lock_);
    throw;
  }
}

SocketClaim::~SocketClaim() {
  (void)unlink(path_.c_str());
  (void)unlink(stream_path(path_).c_str());
  (void)unlink(lock_path_.c_str());
  close(lock_);
}

int listen_at(const std::filesystem::path& path, int type) {
  const sockaddr_un address = address_of(path);
  const int file = socket(AF_UNIX, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (file < 0) fail("socket");
  // The mode of an unbound socket becomes that of its file: it is closed to others from the start.
  if (fchmod(file, 0600) != 0 ||
      bind(file, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      listen(file, kMostInLine) != 0) {
    const int reason = errno;
    close(file);
    errno = reason;
    fail("cannot create a socket at '" + path.string() + "'");
  }
  return file;
}

int connect_to(const std::filesystem::path& path, int type) {
  const sockaddr_un address = address_of(path);
  const int file = socket(AF_UNIX, type | SOCK_CLOEXEC, 0);
  if (file < 0) return -1;
  constexpr timeval kPatience{.tv_sec = 2, .tv_usec = 0};  // a frozen run accepts none
  (void)setsockopt(file, SOL_SOCKET, SO_SNDTIMEO, &kPatience, sizeof(kPatience));
  if (connect(file, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) return file;
  const int reason = errno;
  close(file);
  errno = reason;
  return -1;
}

}  // namespace multipanda
