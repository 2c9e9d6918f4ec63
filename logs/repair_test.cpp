#include <csignal>
#include <random>
#include <sys/resource.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "logs/export.hpp"
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

// Chunks that cannot be read in the middle of a closed log, whether their content or their head is damaged,
// are counted and left out; all others are kept.
TEST_F(Repair, DamageInTheMiddleOfAClosedLogIsCountedAndLeftOut) {
  std::vector<std::pair<std::size_t, std::size_t>> chunks;  // offset, length
  {
    McapScanner scanner(log_);
    while (const auto record = scanner.next())
      if (record->opcode == mcap::Opcode::chunk)
        chunks.emplace_back(record->offset, mcap::kRecordHead + record->content.size());
  }
  ASSERT_GT(chunks.size(), 8u);
  const auto [all, closed] = read(log_);
  ASSERT_TRUE(closed);
  const std::size_t per_chunk = all.size() / (chunks.size() - 1);
  const auto damaged = [&](std::size_t from, std::size_t size, char with) {
    std::string bytes = whole_;
    for (std::size_t i = from; i < from + size; ++i) bytes[i] = with;
    return bytes;
  };
  const auto [at, length] = chunks[3];
  const std::string head_of_another = damaged(at, mcap::kRecordHead, '\x7f');
  for (const std::string& bytes : {damaged(at + length / 2, 20, '\x55'), damaged(at, mcap::kRecordHead, '\0'),
                                   damaged(at - 2, 30, '\0'), damaged(at + 1, 8, '\x01'), head_of_another}) {
    put_content(log_, bytes);
    const auto before = read(log_).first;
    EXPECT_GE(before.size() + 2 * per_chunk + 2, all.size());
    EXPECT_LT(before.size(), all.size());
    EXPECT_TRUE(repair_log(log_, true).was_complete);  // as asked, a closed log stays
    EXPECT_EQ(content_of(log_), bytes);
    const RepairResult result = repair_log(log_);
    EXPECT_FALSE(result.was_complete);
    EXPECT_EQ(result.chunks_dropped, 1u);
    EXPECT_EQ(result.bytes_dropped, 0u);
    EXPECT_EQ(result.messages, before.size());
    McapReader reader(log_);
    while (reader.next()) {
    }
    EXPECT_EQ(reader.damaged_records(), 0u);
    EXPECT_EQ(read(log_), std::make_pair(before, true));
    EXPECT_TRUE(repair_log(log_).was_complete);
  }
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
