#include <array>
#include <cstring>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "runtime/live_input/client.hpp"
#include "runtime/live_input/server.hpp"
#include "runtime/live_input/testing/live_fixture.hpp"

namespace multipanda::records_request_test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

// A client that takes descriptors, too.
class Taker {
 public:
  explicit Taker(const std::filesystem::path& path) : file_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{.sun_family = AF_UNIX, .sun_path = {}};
    std::strncpy(address.sun_path, path.c_str(), sizeof(address.sun_path) - 1);
    EXPECT_EQ(connect(file_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  }
  ~Taker() { close(file_); }
  Taker(const Taker&) = delete;

  void tell(const std::string& line) const {
    EXPECT_EQ(send(file_, line.data(), line.size(), MSG_NOSIGNAL), static_cast<ssize_t>(line.size()));
  }
  // The next line, and the descriptor that came with its bytes; -1: none.
  std::pair<json, int> next() {
    int passed = -1;
    while (in_.find('\n') == std::string::npos) {
      std::array<char, 4096> block;
      iovec part{.iov_base = block.data(), .iov_len = block.size()};
      alignas(cmsghdr) std::array<char, 256> control;
      msghdr message{};
      message.msg_iov = &part;
      message.msg_iovlen = 1;
      message.msg_control = control.data();
      message.msg_controllen = control.size();
      const ssize_t n = recvmsg(file_, &message, MSG_CMSG_CLOEXEC);
      if (n <= 0) return {json(), passed};
      in_.append(block.data(), static_cast<std::size_t>(n));
      for (cmsghdr* head = CMSG_FIRSTHDR(&message); head != nullptr; head = CMSG_NXTHDR(&message, head))
        std::memcpy(&passed, CMSG_DATA(head), sizeof(int));
    }
    const std::size_t end = in_.find('\n');
    const json line = json::parse(in_.substr(0, end));
    in_.erase(0, end + 1);
    return {line, passed};
  }

 private:
  int file_;
  std::string in_;
};

class RecordsRequest : public testing::Test {
 protected:
  RecordsRequest()
      : records_("fixture", fixture_.loop.cycle.layout(), fixture_.loop.models, {ArmFrames{}, ArmFrames{}}) {
    LiveInputContext run = fixture_.run();
    run.records = &records_;
    server_.emplace(folder_ / "fixture.sock", run);
  }
  void until_readers(std::size_t count) const {
    while (server_->record_readers() != count) std::this_thread::yield();
  }

  test::PrivateFolder folder_;
  test::LiveFixture fixture_;
  SharedRecords records_;
  std::optional<LiveServer> server_;
};

TEST_F(RecordsRequest, IsAnsweredWithTheMemory) {
  Taker client(server_->path());
  client.tell("{\"id\": 5, \"do\": \"records\"}\n");
  const auto [answer, file] = client.next();
  EXPECT_EQ(answer["id"], 5);
  EXPECT_EQ(answer["hash"], records_.hash());
  ASSERT_GE(file, 0);
  struct stat ours {
  }, theirs{};
  ASSERT_EQ(fstat(file, &theirs) + fstat(records_.memory().file(), &ours), 0);
  EXPECT_EQ(theirs.st_ino, ours.st_ino);
  EXPECT_EQ(answer["bytes"], theirs.st_size);
  close(file);
}

// The descriptor comes with its own answer, whatever stands before and behind it.
TEST_F(RecordsRequest, TheMemoryComesWithItsAnswerAndOnce) {
  Taker client(server_->path());
  client.tell(
      "{\"id\": 1, \"do\": \"list\"}\n{\"id\": 2, \"do\": \"records\"}\n{\"id\": 3, \"do\": \"records\"}\n");
  const auto [list, none] = client.next();
  EXPECT_EQ(list["id"], 1);
  const auto [answer, file] = client.next();
  EXPECT_EQ(answer["id"], 2);
  const auto [again, no_more] = client.next();
  EXPECT_EQ(again["ok"], false);
  EXPECT_THAT(again["reason"].get<std::string>(), HasSubstr("already"));
  // Parts of a stream may arrive together: one descriptor in all.
  EXPECT_EQ((none >= 0) + (file >= 0) + (no_more >= 0), 1);
  for (const int passed : {none, file, no_more}) {
    if (passed >= 0) close(passed);
  }
}

TEST_F(RecordsRequest, ReadersAreCountedUntilTheyGo) {
  EXPECT_EQ(server_->record_readers(), 0u);
  {
    Taker a(server_->path()), b(server_->path());
    for (Taker* client : {&a, &b}) {
      client->tell("{\"do\": \"records\"}\n");
      close(client->next().second);
    }
    until_readers(2);
  }
  until_readers(0);
}

TEST_F(RecordsRequest, ARunWithoutThemSaysSo) {
  LiveServer server(folder_ / "other.sock", fixture_.run());
  LiveClient client(server.path());
  const json answer = client.ask({{"do", "records"}});
  EXPECT_EQ(answer["ok"], false);
  EXPECT_THAT(answer["reason"].get<std::string>(), HasSubstr("shares no records"));
}

TEST_F(RecordsRequest, EpisodesAreBegunAndJudgedOnce) {
  std::vector<EpisodeMark> marks;
  LiveInputContext run = fixture_.run();
  run.mark = [&marks](const EpisodeMark& mark) { marks.push_back(mark); };
  fixture_.steps(3);
  RequestHandler handler(run);
  RequestHandler::Pending pending;
  const auto ask = [&](const char* mark) -> std::string {
    try {
      return handler.begin({{"do", "episode"}, {"mark", mark}}, pending)->at("episode").dump();
    } catch (const RequestRefused& refused) {
      return refused.what();
    }
  };
  EXPECT_THAT(ask("success"), HasSubstr("no episode has begun"));
  EXPECT_THAT(ask("discard"), HasSubstr("no episode has begun"));
  EXPECT_EQ(ask("start"), "1");
  EXPECT_THAT(ask("start"), HasSubstr("episode 1 is not over"));
  EXPECT_EQ(ask("failure"), "1");
  EXPECT_THAT(ask("failure"), HasSubstr("no episode has begun"));
  EXPECT_EQ(ask("discard"), "1");
  EXPECT_EQ(ask("start"), "2");
  EXPECT_THAT(ask("done"), HasSubstr("start, success, failure, discard"));
  ASSERT_EQ(marks.size(), 4u);
  EXPECT_EQ(marks[1].kind, EpisodeMark::Kind::failure);
  EXPECT_EQ(marks[3].episode, 2u);
  EXPECT_EQ(marks[3].cycle, 3u);
}

}  // namespace
}  // namespace multipanda::records_request_test
