#include "fci/client/net_ft.hpp"

#include <arpa/inet.h>
#include <cstring>
#include <functional>
#include <mutex>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <gtest/gtest.h>

// Against a device emulated from ATI's manual of the Net F/T (9620-05): it streams to whoever sent 0x1234 and
// command 2. Nothing here was tried on hardware.
namespace multipanda::fci::net_ft_test {
namespace {

using Counts = std::array<std::int32_t, 6>;

// A thread that answers requests and sends a record every millisecond while it streams.
class Device {
 public:
  Device() { plug_in(); }
  ~Device() { unplug(); }

  void plug_in(std::uint16_t port = 0) {
    socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_port = htons(port);
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof here;
    if (::bind(socket_, reinterpret_cast<const sockaddr*>(&here), size) != 0 ||
        ::getsockname(socket_, reinterpret_cast<sockaddr*>(&here), &size) != 0)
      throw std::runtime_error("no port for the emulated device");
    port_ = ntohs(here.sin_port);
    ending_ = false;
    thread_ = std::thread([this] { serve(); });
  }
  void unplug() {
    ending_ = true;
    if (thread_.joinable()) thread_.join();
    if (socket_ >= 0) ::close(socket_);
    socket_ = -1;
  }
  std::uint16_t port() const { return port_; }

  // What it measures; from any thread.
  void set(const Counts& counts, std::uint32_t status = 0) {
    const std::lock_guard lock(mutex_);
    counts_ = counts;
    status_ = status;
  }
  void mute(bool on) { muted_ = on; }
  void restart(std::uint32_t at = 10) { sample_ = at; }
  // Instead of the next number of a sample, and beside the stream.
  void send_raw(const std::vector<unsigned char>& bytes) {
    const std::lock_guard lock(mutex_);
    ::sendto(socket_, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&client_),
             sizeof client_);
  }
  std::vector<unsigned char> record(std::uint32_t sample, const Counts& counts, std::uint32_t status = 0) {
    std::vector<unsigned char> bytes;
    const auto put = [&](std::uint32_t value) {
      for (const int shift : {24, 16, 8, 0}) bytes.push_back(static_cast<unsigned char>(value >> shift));
    };
    put(++sequence_);
    put(sample);
    put(status);
    for (const std::int32_t value : counts) put(static_cast<std::uint32_t>(value));
    return bytes;
  }
  std::uint32_t sample() const { return sample_; }
  bool streams() const { return streams_; }
  int requests() const { return requests_; }

 private:
  void serve() {
    pollfd readable{.fd = socket_, .events = POLLIN, .revents = 0};
    while (!ending_) {
      if (::poll(&readable, 1, 1) > 0) {
        std::array<unsigned char, 16> request{};
        const std::lock_guard lock(mutex_);
        socklen_t size = sizeof client_;
        const ssize_t got = ::recvfrom(socket_, request.data(), request.size(), 0,
                                       reinterpret_cast<sockaddr*>(&client_), &size);
        constexpr std::array<unsigned char, 8> kStream{0x12, 0x34, 0, 2, 0, 0, 0, 0}, kStop{0x12, 0x34};
        if (got != 8) continue;
        if (std::memcmp(request.data(), kStream.data(), 8) == 0) {
          streams_ = true;
          sequence_ = 0;
          ++requests_;
        }
        if (std::memcmp(request.data(), kStop.data(), 8) == 0) streams_ = false;
      }
      if (!streams_ || muted_) continue;
      Counts counts;
      std::uint32_t status;
      {
        const std::lock_guard lock(mutex_);
        counts = counts_;
        status = status_;
      }
      send_raw(record(sample_ += 7, counts, status));
    }
  }

  int socket_ = -1;
  std::uint16_t port_ = 0;
  std::thread thread_;
  std::mutex mutex_;
  sockaddr_in client_{};
  Counts counts_{};
  std::uint32_t status_ = 0;
  std::atomic<std::uint32_t> sample_{10000000}, sequence_{0};
  std::atomic<bool> ending_{false}, streams_{false}, muted_{false};
  std::atomic<int> requests_{0};
};

bool eventually(const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

struct NetFtTest : testing::Test {
  NetFtTest()
      : sensor({.who = "arm left: force sensor",
                .address = "127.0.0.1",
                .port = device.port(),
                .counts_per_n = 1000,
                .counts_per_nm = 1e5,
                .report = [this](const std::string& text) {
                  const std::lock_guard lock(mutex);
                  messages += text + "\n";
                }}) {}
  bool told(const std::string& text) {
    const std::lock_guard lock(mutex);
    return messages.find(text) != std::string::npos;
  }
  bool shows(double fx, Intervention fault = Intervention::none) {
    return eventually([&] {
      const ForceReading& now = sensor.latest();
      return now.F_S.vector[0] == fx && now.fault == fault;
    });
  }
  Device device;
  std::mutex mutex;
  std::string messages;
  NetFt sensor;
};

TEST_F(NetFtTest, ScalesTheCountsOfEachAxis) {
  device.set({1000, -2000, 3000, 100000, -200000, 50000});
  sensor.start();
  const Vector6 expected = (Vector6() << 1, -2, 3, 1, -2, 0.5).finished();
  ASSERT_TRUE(shows(1));
  EXPECT_LT((sensor.latest().F_S.vector - expected).norm(), 1e-12);
  EXPECT_TRUE(eventually([&] { return (sensor.latest().mean_S.vector - expected).norm() < 1e-9; }));
  device.set(
      {std::numeric_limits<std::int32_t>::min(), 0, 0, 0, 0, std::numeric_limits<std::int32_t>::max()});
  ASSERT_TRUE(shows(-2147483.648));
  EXPECT_NEAR(sensor.latest().F_S.vector[5], 21474.83647, 1e-9);
  sensor.stop();
  EXPECT_TRUE(eventually([&] { return !device.streams(); }));  // nothing is left behind
}

TEST_F(NetFtTest, NamesTheStatusOfTheDevice) {
  sensor.start();
  device.set({1000}, 1u << 31 | 1u << 17);
  EXPECT_TRUE(shows(1, Intervention::force_sensor_saturated));
  EXPECT_TRUE(eventually([&] { return told("its status is 0x80020000"); }));
  device.set({2000}, 1u << 31 | 1u << 29);
  EXPECT_TRUE(shows(2, Intervention::force_sensor_fault));
  device.set({3000}, 1u << 16);  // a user's threshold
  EXPECT_TRUE(shows(3));
  device.set({4000});
  EXPECT_TRUE(shows(4));
}

TEST_F(NetFtTest, SilenceAgesAndTheStreamIsAskedForAgain) {
  sensor.start();
  device.mute(true);
  EXPECT_TRUE(eventually([&] { return sensor.latest().age_s > 0.3; }));
  EXPECT_TRUE(eventually([&] { return device.requests() > 1; }));
  EXPECT_TRUE(eventually([&] { return told("it is silent"); }));
  device.set({5000});
  device.mute(false);
  EXPECT_TRUE(shows(5));
  EXPECT_TRUE(eventually([&] { return told("it sends again"); }));
}

TEST_F(NetFtTest, ReturnsAfterItWasUnplugged) {
  sensor.start();
  const std::uint16_t port = device.port();
  device.unplug();
  EXPECT_TRUE(eventually([&] { return sensor.latest().age_s > 0.3; }));
  device.set({6000});
  device.plug_in(port);
  EXPECT_TRUE(shows(6));
}

TEST_F(NetFtTest, DropsLateRepeatedAndForeignDatagrams) {
  sensor.start();
  device.mute(true);
  ASSERT_TRUE(eventually([&] { return sensor.latest().age_s > 0.05; }));
  const std::uint32_t newest = device.sample() + 500;  // a last record of the stream may still come
  device.send_raw(device.record(newest, {1000}));
  ASSERT_TRUE(shows(1));
  device.send_raw(device.record(newest, {9000}));
  device.send_raw(device.record(newest - 300, {9000}));
  device.send_raw({1, 2, 3});
  device.send_raw(std::vector<unsigned char>(64, 0x12));
  device.send_raw({});
  EXPECT_TRUE(eventually([&] { return sensor.late() >= 2 && sensor.foreign() == 3; }));
  EXPECT_EQ(sensor.latest().F_S.vector[0], 1);
  EXPECT_EQ(sensor.latest().fault, Intervention::none);
}

TEST_F(NetFtTest, ARestartedDeviceStaysAFault) {
  sensor.start();
  device.restart();
  device.set({7000});
  EXPECT_TRUE(shows(7, Intervention::force_sensor_fault));
  EXPECT_TRUE(eventually([&] { return told("it was restarted"); }));
  const std::uint64_t before = sensor.latest().records;
  ASSERT_TRUE(eventually([&] { return sensor.latest().records > before + 20; }));
  EXPECT_EQ(sensor.latest().fault, Intervention::force_sensor_fault);
  sensor.start();
  EXPECT_TRUE(shows(7));
}

TEST_F(NetFtTest, TheNumbersOfSamplesMayWrapAround) {
  device.restart(0xFFFFFFFF - 700);  // a few hundred records later
  sensor.start();
  EXPECT_TRUE(eventually([&] { return device.sample() < 0x10000000; }));
  device.set({5000});
  EXPECT_TRUE(shows(5));
}

// After three and a half days of a device, a new one's number is "ahead" of its last.
TEST_F(NetFtTest, ARestartAfterDaysIsAFault) {
  device.restart(0xF0000000);
  sensor.start();
  device.restart();
  device.set({7000});
  EXPECT_TRUE(shows(7, Intervention::force_sensor_fault));
}

// A device that was restarted soon after its start, while nothing was heard of it for longer.
TEST_F(NetFtTest, ANumberThatMayHaveBegunInTheSilenceIsAFault) {
  device.restart(10);
  sensor.start();
  device.mute(true);
  ASSERT_TRUE(eventually([&] { return sensor.latest().age_s > 2; }));
  device.restart(device.sample() + 2000);
  device.set({8000});
  device.mute(false);
  EXPECT_TRUE(shows(8, Intervention::force_sensor_fault));
}

// What was averaged before a silence, or a fault, is not a mean of now: the arm may bear something else.
TEST_F(NetFtTest, AMeanOfBeforeASilenceIsNone) {
  device.set({9000});
  sensor.start();
  device.mute(true);
  ASSERT_TRUE(eventually([&] { return sensor.latest().age_s > 0.1; }));
  device.set({1000});
  device.mute(false);
  EXPECT_TRUE(eventually([&] {
    const ForceReading& now = sensor.latest();
    if (now.F_S.vector[0] != 1) return false;
    EXPECT_FALSE(now.mean_S.vector[0] > 1.001) << "the mean of before";
    return true;
  }));
  EXPECT_TRUE(eventually([&] { return std::abs(sensor.latest().mean_S.vector[0] - 1) < 1e-9; }));
}

TEST_F(NetFtTest, ADeviceThatDoesNotAnswerIsReported) {
  device.unplug();
  try {
    sensor.start();
    ADD_FAILURE() << "started";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("arm left: force sensor at 127.0.0.1: no records from UDP port"),
              std::string::npos);
  }
}

}  // namespace
}  // namespace multipanda::fci::net_ft_test
