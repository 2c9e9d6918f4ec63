#include "logs/repair.hpp"

#include <csignal>
#include <random>
#include <sys/resource.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "logs/mcap_reader.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_files.hpp"

namespace multipanda::repair_test {
namespace {

class Repair : public testing::Test {
 protected:
  Repair() {
    McapWriter writer(log_, {.chunk_bytes = 3000});
    writer.add(mcap::Metadata{"run", {{"scene", "two_arms"}}});
    const auto channel = writer.add_channel<msg::ArmState>("/left/state");
    for (std::uint64_t i = 0; i < 400; ++i) {
      msg::ArmState message;
      message.cycle = i;
      message.q.assign(7, 0.1);
      writer.write(channel, static_cast<std::int64_t>(i), message);
    }
    writer.close();
    whole_ = content_of(log_);
  }

  // Cycle numbers of the messages, and whether the file is complete.
  static std::pair<std::vector<std::uint64_t>, bool> read(const std::filesystem::path& path) {
    McapReader reader(path);
    std::vector<std::uint64_t> cycles;
    while (const auto message = reader.next()) cycles.push_back(from_cdr<msg::ArmState>(message->data).cycle);
    return {cycles, reader.complete()};
  }

  TestFolder folder_;
  std::filesystem::path log_ = folder_ / "log.mcap";
  std::string whole_;
};

TEST_F(Repair, CompleteLogStaysAsItIs) {
  const RepairResult result = repair_log(log_);
  EXPECT_TRUE(result.was_complete);
  EXPECT_EQ(result.messages, 400u);
  EXPECT_EQ(content_of(log_), whole_);
}

TEST_F(Repair, CutAnywhereKeepsAllWholeChunks) {
  std::mt19937 random(21);
  std::size_t most = 0;
  for (int i = 0; i < 100; ++i) {
    put_content(log_, whole_.substr(0, 8 + random() % (whole_.size() - 9)));
    const auto [before, complete_before] = read(log_);
    EXPECT_FALSE(complete_before);
    const RepairResult result = repair_log(log_);
    const auto [after, complete] = read(log_);
    EXPECT_TRUE(complete);
    EXPECT_EQ(after, before);
    EXPECT_EQ(result.messages, before.size());
    EXPECT_TRUE(repair_log(log_).was_complete);
    for (std::size_t k = 0; k < after.size(); ++k) EXPECT_EQ(after[k], k);
    most = std::max(most, after.size());
  }
  EXPECT_GT(most, 300u);
}

// Cut directly after the last chunk: everything is present, and the index is the same as that of a properly
// closed file.
TEST_F(Repair, IndexEqualsThatOfAClosedLog) {
  std::uint64_t end = 0;
  McapScanner scanner(log_);
  while (const auto record = scanner.next()) {
    if (record->opcode == mcap::Opcode::data_end) break;
    end = scanner.whole_bytes();
  }
  put_content(log_, whole_.substr(0, end));
  repair_log(log_);
  EXPECT_EQ(content_of(log_), whole_);
}

TEST_F(Repair,
       ZerosAtTheEndAreDropped) {  // a block that was allocated but never written, as after a power failure
  const std::size_t cut = whole_.size() / 2;
  put_content(log_, whole_.substr(0, cut));
  const auto before = read(log_).first;
  put_content(log_, whole_.substr(0, cut) + std::string(5000, '\0'));
  const RepairResult result = repair_log(log_);
  EXPECT_EQ(read(log_).first, before);
  EXPECT_GT(result.bytes_dropped, 5000u - 3000u);  // the last chunk, cut, may have taken some as its own
}

TEST_F(Repair, RefusesALogThatIsStillBeingWritten) {
  McapWriter writer(log_);
  const std::string before = content_of(log_);
  EXPECT_THROW(repair_log(log_), std::runtime_error);
  EXPECT_EQ(content_of(log_), before);
  writer.close();
  EXPECT_TRUE(repair_log(log_).was_complete);
}

TEST_F(Repair, RestOfAKilledRepairDoesNotMatter) {
  put_content(log_, whole_.substr(0, whole_.size() / 2));
  put_content(log_.string() + ".repair", "half a file");
  repair_log(log_);
  EXPECT_TRUE(read(log_).second);
}

TEST_F(Repair, FailureLeavesTheLogAlone) {
  const std::string cut = whole_.substr(0, whole_.size() / 2);
  put_content(log_, cut);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit limit{1000, before.rlim_max};
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &limit);
  EXPECT_THROW(repair_log(log_), std::runtime_error);
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(content_of(log_), cut);
  EXPECT_FALSE(std::filesystem::exists(log_.string() + ".repair"));
  EXPECT_THROW(repair_log(folder_ / "none.mcap"), std::runtime_error);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none.mcap.repair"));
}

}  // namespace
}  // namespace multipanda::repair_test
