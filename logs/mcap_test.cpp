#include <map>
#include <random>
#include <sys/resource.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "logs/mcap_reader.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_files.hpp"
#include "logs/testing/test_messages.hpp"

namespace multipanda::mcap_test {
namespace {

msg::ArmState state(std::uint64_t cycle) {
  msg::ArmState message;
  message.cycle = cycle;
  message.arm = "left";
  message.q.assign(7, 0.001 * static_cast<double>(cycle));
  return message;
}

// Noise does not compress: the file grows by the size of its messages.
msg::Event noise(std::mt19937& random, std::uint64_t cycle) {
  msg::Event message;
  message.cycle = cycle;
  message.values.resize(100);
  for (double& value : message.values) value = std::uniform_real_distribution<double>(-1, 1)(random);
  return message;
}

// While this object lives, no file of this process can grow beyond `bytes`, as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    getrlimit(RLIMIT_FSIZE, &before_);
    set(bytes);
  }
  ~FileSizeLimit() { setrlimit(RLIMIT_FSIZE, &before_); }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;
  void set(rlim_t bytes) {
    const rlimit limit{bytes, before_.rlim_max};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  }

 private:
  rlimit before_{};
};

TEST(Mcap, RoundTripInOrder) {
  const TestFolder folder;
  const auto path = folder / "log.mcap";
  {
    McapWriter writer(path, {.chunk_bytes = 5000});
    const auto left = writer.add_channel<msg::ArmState>("/left/state");
    const auto event = writer.add_channel<msg::Event>("/events");
    EXPECT_TRUE(writer.add(mcap::Metadata{"run", {{"scene", "two_arms"}}}));
    EXPECT_TRUE(writer.add(mcap::Attachment{1, 2, "scene.yaml", "application/yaml", "arms: []"}));
    for (std::uint64_t i = 0; i < 1000; ++i) {
      writer.write(left, static_cast<std::int64_t>(i) * 1000000, state(i));
      if (i % 100 == 0) writer.write(event, static_cast<std::int64_t>(i) * 1000000, msg::Event{});
    }
    const WriterStatus& status = writer.close();
    EXPECT_TRUE(status.closed);
    EXPECT_EQ(status.error, "");
    EXPECT_EQ(status.messages_written, 1010u);
    EXPECT_EQ(status.messages_lost, 0u);
    EXPECT_EQ(status.bytes, std::filesystem::file_size(path));
  }
  McapReader reader(path);
  std::uint64_t states = 0, events = 0;
  std::int64_t last = 0;
  while (const auto message = reader.next()) {
    EXPECT_GE(message->log_time_ns, last);
    last = message->log_time_ns;
    if (message->channel->topic == "/left/state") {
      EXPECT_EQ(message->schema->name, "multipanda_msgs/msg/ArmState");
      EXPECT_EQ(message->schema->text, msg::ArmState::kText);
      EXPECT_EQ(message->sequence, states);
      const auto back = from_cdr<msg::ArmState>(message->data);
      EXPECT_EQ(back.fields(), state(states).fields());
      ++states;
    } else {
      ++events;
    }
  }
  EXPECT_EQ(states, 1000u);
  EXPECT_EQ(events, 10u);
  EXPECT_TRUE(reader.complete());
  EXPECT_EQ(reader.missing_bytes(), 0u);
  EXPECT_EQ(reader.damaged_records(), 0u);
  ASSERT_EQ(reader.metadata().size(), 1u);
  EXPECT_EQ(reader.metadata()[0].values.at("scene"), "two_arms");
  ASSERT_EQ(reader.attachments().size(), 1u);
  EXPECT_EQ(reader.attachments()[0].data, "arms: []");
}

TEST(Mcap, EmptyLogIsComplete) {
  const TestFolder folder;
  McapWriter(folder / "log.mcap").close();
  McapReader reader(folder / "log.mcap");
  EXPECT_FALSE(reader.next());
  EXPECT_TRUE(reader.complete());
}

// The file of a killed process is what it contains while the writer is still open.
TEST(Mcap, OldChunksAreInTheFileBeforeClosing) {
  const TestFolder folder;
  McapWriter writer(folder / "log.mcap",
                    {.chunk_bytes = 1u << 30, .chunk_age = std::chrono::milliseconds(0)});
  const auto channel = writer.add_channel<msg::ArmState>("/left/state");
  for (std::uint64_t i = 0; i < 30; ++i) {
    writer.write(channel, 0, state(i));
    if (i % 10 == 9) writer.flush_if_due();
  }
  writer.write(channel, 0, state(30));  // collected, not flushed
  McapReader reader(folder / "log.mcap");
  int count = 0;
  while (reader.next()) ++count;
  EXPECT_EQ(count, 30);
  EXPECT_FALSE(reader.complete());
}

TEST(Mcap, DamagedChunkIsSkippedAndCounted) {
  const TestFolder folder;
  const auto path = folder / "log.mcap";
  {
    McapWriter writer(path, {.chunk_bytes = 4000});
    const auto channel = writer.add_channel<msg::ArmState>("/left/state");
    for (std::uint64_t i = 0; i < 500; ++i) writer.write(channel, 0, state(i));
  }
  std::uint64_t in_chunk = 0;
  std::string bytes = content_of(path);
  {
    McapScanner scanner(path);
    int chunks = 0;
    while (const auto record = scanner.next()) {
      if (record->opcode != mcap::Opcode::chunk || ++chunks != 3) continue;
      const std::string records = mcap::decode_chunk(record->content).records;
      for (std::size_t at = 0; at < records.size(); ++in_chunk)
        (void)mcap::take_record(mcap::as_bytes(records), at);
      bytes[record->offset + record->content.size() - 20] ^= 0x10;  // in the compressed data
    }
    ASSERT_GE(chunks, 5);
  }
  put_content(path, bytes);
  McapReader reader(path);
  std::uint64_t count = 0;
  while (reader.next()) ++count;
  EXPECT_EQ(reader.damaged_records(), 1u);
  EXPECT_EQ(count, 500 - in_chunk);
  EXPECT_TRUE(reader.complete());
}

TEST(Mcap, AnyDamageIsSurvived) {
  const TestFolder folder;
  const auto path = folder / "log.mcap";
  {
    McapWriter writer(path, {.chunk_bytes = 2000});
    const auto channel = writer.add_channel<msg::ArmState>("/left/state");
    for (std::uint64_t i = 0; i < 100; ++i) writer.write(channel, 0, state(i));
  }
  const std::string whole = content_of(path);
  std::mt19937 random(11);
  for (int i = 0; i < 300; ++i) {
    std::string bytes = whole;
    for (int k = 0; k < 3; ++k) bytes[8 + random() % (bytes.size() - 8)] = static_cast<char>(random());
    put_content(path, bytes);
    McapReader reader(path);
    int count = 0;
    while (reader.next()) ++count;
    EXPECT_LE(count, 100);
  }
}

TEST(Mcap, RefusesFilesThatAreNotLogs) {
  const TestFolder folder;
  EXPECT_THROW(McapReader(folder / "none.mcap"), std::runtime_error);
  put_content(folder / "text.mcap", "hello, this is not a log");
  EXPECT_THROW(McapReader(folder / "text.mcap"), std::runtime_error);
  EXPECT_THROW(McapWriter(folder / "no_such_folder" / "log.mcap"), std::runtime_error);
}

TEST(McapFullDisk, CountsWhatIsMissingAndClosesTheFile) {
  const TestFolder folder;
  const auto path = folder / "log.mcap";
  constexpr std::uint64_t kMessages = 2000;  // of 0.85 kB
  std::mt19937 random(3);
  WriterStatus status;
  {
    const FileSizeLimit limit(600'000);
    McapWriter writer(path, {.chunk_bytes = 50'000});
    const auto events = writer.add_channel<msg::Event>("/events");
    const auto states = writer.add_channel<msg::ArmState>("/left/state");
    for (std::uint64_t i = 0; i < kMessages; ++i) {
      writer.write(events, static_cast<std::int64_t>(i), noise(random, i));
      if (i % 10 == 0) writer.write(states, static_cast<std::int64_t>(i), state(i));
    }
    status = writer.close();
  }
  EXPECT_TRUE(status.closed) << "room for the footer was reserved";
  EXPECT_THAT(status.error, testing::HasSubstr("File too large"));
  EXPECT_GT(status.messages_written, 100u);
  EXPECT_GT(status.messages_lost, 1000u);
  EXPECT_EQ(status.messages_written + status.messages_lost, kMessages + kMessages / 10);

  std::map<std::string, std::uint64_t> read;
  McapReader reader(path);
  while (const auto message = reader.next()) ++read[message->channel->topic];
  EXPECT_TRUE(reader.complete());
  EXPECT_EQ(read["/events"] + status.lost_by_topic["/events"], kMessages);
  EXPECT_EQ(read["/left/state"] + status.lost_by_topic["/left/state"], kMessages / 10);
  EXPECT_EQ(read["/events"] + read["/left/state"], status.messages_written);
}

TEST(McapFullDisk, ContinuesWhenThereIsSpaceAgain) {
  const TestFolder folder;
  const auto path = folder / "log.mcap";
  std::mt19937 random(3);
  WriterStatus status;
  {
    FileSizeLimit limit(300'000);
    McapWriter writer(path, {.chunk_bytes = 50'000});
    const auto events = writer.add_channel<msg::Event>("/events");
    for (std::uint64_t i = 0; i < 1000; ++i) writer.write(events, 0, noise(random, i));
    EXPECT_GT(writer.status().messages_lost, 0u);
    limit.set(RLIM_INFINITY);
    writer.flush();
    const std::uint64_t lost = writer.status().messages_lost;
    for (std::uint64_t i = 1000; i < 1500; ++i) writer.write(events, 0, noise(random, i));
    status = writer.close();
    EXPECT_EQ(status.messages_lost, lost);
  }
  McapReader reader(path);
  std::uint64_t count = 0, last = 0;
  while (const auto message = reader.next()) {
    last = from_cdr<msg::Event>(message->data).cycle;
    EXPECT_EQ(message->sequence, last);  // the sequence numbers show the gap
    ++count;
  }
  EXPECT_EQ(last, 1499u);
  EXPECT_EQ(count, status.messages_written);
  EXPECT_TRUE(reader.complete());
}

TEST(McapFullDisk, FullFromTheStart) {
  McapWriter writer("/dev/full");
  const auto events = writer.add_channel<msg::Event>("/events");
  for (std::uint64_t i = 0; i < 100; ++i) writer.write(events, 0, msg::Event{});
  const WriterStatus& status = writer.close();
  EXPECT_FALSE(status.closed);
  EXPECT_EQ(status.messages_written, 0u);
  EXPECT_EQ(status.messages_lost, 100u);
  EXPECT_THAT(status.error, testing::HasSubstr("No space left"));
}

TEST(Definitions, DoNotDependOnComments) {
  mcap::Schema schema{1, std::string(msg::ArmState::kType), "ros2msg", std::string(msg::ArmState::kText)};
  schema.text.insert(0, "# another comment\n\n");
  EXPECT_TRUE(holds<msg::ArmState>(schema));
  EXPECT_FALSE(holds<msg::ArmCommand>(schema));
  schema.text.replace(schema.text.find("float64 age"), 11, "float32 age");
  EXPECT_THROW(holds<msg::ArmState>(schema), std::runtime_error);
}

}  // namespace
}  // namespace multipanda::mcap_test
