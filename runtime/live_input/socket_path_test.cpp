#include "runtime/live_input/socket_path.hpp"

#include <fstream>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "runtime/live_input/testing/live_fixture.hpp"

namespace multipanda::socket_path_test {
namespace {

unsigned mode_of(const std::filesystem::path& path) {
  struct stat info {};
  EXPECT_EQ(lstat(path.c_str(), &info), 0) << path;
  return info.st_mode & 0777u;
}

TEST(SocketPathTest, TheFolderIsClosedToOthers) {
  const test::PrivateFolder folder;
  make_private_folder(folder / "new");
  EXPECT_EQ(mode_of(folder / "new"), 0700u);
  make_private_folder(folder / "new");  // there already
  ASSERT_EQ(chmod((folder / "new").c_str(), 0750), 0);
  EXPECT_THROW(make_private_folder(folder / "new"), std::runtime_error);
  ASSERT_EQ(chmod((folder / "new").c_str(), 0700), 0);
  std::filesystem::create_directory_symlink(folder / "new", folder / "link");
  EXPECT_THROW(make_private_folder(folder / "link"), std::runtime_error);
  EXPECT_THROW(make_private_folder("/proc/no/such"), std::runtime_error);
}

TEST(SocketPathTest, TheSocketIsClosedToOthers) {
  const test::PrivateFolder folder;
  const SocketClaim claim(folder / "a.sock");
  const int file = listen_at(claim.path(), SOCK_STREAM);
  EXPECT_EQ(mode_of(claim.path()), 0600u);
  close(file);
}

TEST(SocketPathTest, ALiveOwnerKeepsItsSocket) {
  const test::PrivateFolder folder;
  {
    const SocketClaim claim(folder / "a.sock");
    EXPECT_THROW(SocketClaim(folder / "a.sock"), SocketTaken);
    EXPECT_NO_THROW(SocketClaim(folder / "b.sock"));
  }
  EXPECT_NO_THROW(SocketClaim(folder / "a.sock"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));  // nothing is left behind
}

TEST(SocketPathTest, TheSocketOfADeadProcessIsReplaced) {
  const test::PrivateFolder folder;
  const auto path = folder / "a.sock";
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {  // dies without cleaning up
    new SocketClaim(path);
    (void)listen_at(path, SOCK_STREAM);
    (void)listen_at(stream_path(path), SOCK_SEQPACKET);
    _exit(0);
  }
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  ASSERT_TRUE(std::filesystem::is_socket(path));
  EXPECT_TRUE(running_sockets(folder.path()).empty());  // nobody listens there
  const SocketClaim claim(path);
  const int file = listen_at(path, SOCK_STREAM);
  EXPECT_THAT(running_sockets(folder.path()), testing::ElementsAre(path));
  close(file);
}

TEST(SocketPathTest, OtherFilesAreNeverRemoved) {
  const test::PrivateFolder folder;
  const auto path = folder / "a.sock";
  std::ofstream(path) << "precious";
  EXPECT_THROW(SocketClaim{path}, std::runtime_error);
  EXPECT_TRUE(std::filesystem::is_regular_file(path));
}

TEST(SocketPathTest, InvalidAddressesAreReported) {
  EXPECT_THROW(check_socket_path("/tmp/" + std::string(120, 'a')), std::invalid_argument);
  EXPECT_THROW(check_socket_path(""), std::invalid_argument);
  EXPECT_THROW(SocketClaim("/no/such/folder/a.sock"), std::runtime_error);
}

}  // namespace
}  // namespace multipanda::socket_path_test
