#include "core/controllets/teleoperation_channel.hpp"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace multipanda::teleoperation_channel_test {
namespace {

TeleoperationPacket packet(double t, double energy) {
  TeleoperationPacket packet;
  packet.sent_s = t;
  packet.energy = energy;
  packet.X.position.x() = t;
  return packet;
}

TEST(TeleoperationChannel, DeliversInOrderAfterTheDelay) {
  TeleoperationChannel channel;
  channel.start(1);
  for (int k = 0; k < 300; ++k) {
    const double t = 0.001 * k;
    channel.send(packet(t, 0), 0);
    channel.receive(t, 0.05, 0.001);
    ASSERT_EQ(channel.any(), k >= 50) << k;
    if (k < 50) continue;
    ASSERT_NEAR(channel.newest().X.position.x(), t - 0.05, 1e-12) << k;
  }
}

TEST(TeleoperationChannel, DeliversWithoutDelayInTheSameTick) {
  TeleoperationChannel channel;
  channel.start(1);
  channel.send(packet(3, 0.25), 0);
  EXPECT_EQ(channel.receive(3, 0, 0.001), 0.25);
  EXPECT_EQ(channel.newest().sent_s, 3);
  EXPECT_EQ(channel.under_way(), 0);
}

// Delay and loss change at will: what has arrived, is under way or lost is what was sent.
TEST(TeleoperationChannel, NeverCreatesEnergy) {
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    std::mt19937 random(seed);
    const auto between = [&](double a, double b) {
      return std::uniform_real_distribution<double>(a, b)(random);
    };
    TeleoperationChannel channel;
    channel.start(seed);
    double sent = 0, received = 0, delay = 0, loss = 0, t = 0;
    for (int k = 0; k < 5000; ++k) {
      t += between(0.0002, 0.002);
      if (k % 200 == 0) {
        delay = between(0, TeleoperationChannel::kLongestDelay);
        loss = between(0, 0.9);
      }
      const double energy = between(0, 0.01);
      channel.send(packet(t, energy), loss);
      sent += energy;
      received += channel.receive(t, delay, 0.001);
      ASSERT_GE(channel.under_way(), -1e-12);
      ASSERT_NEAR(received + channel.under_way() + channel.lost(), sent, 1e-9) << seed << " " << k;
    }
    EXPECT_GT(channel.lost(), 0.1 * sent);
    EXPECT_GT(received, 0.1 * sent);
  }
}

// Trust in a velocity comes and goes within 20 ms, so nothing that it drives steps. Half of
// the packets suffice.
TEST(TeleoperationChannel, TrustsWhatArrivesInTime) {
  for (const double loss : {0.0, 0.5, 0.95}) {
    TeleoperationChannel channel;
    channel.start(3);
    double before = 0, mean = 0, least = 1;
    for (int k = 0; k < 20000; ++k) {
      const double t = 0.001 * k;
      channel.send(packet(t, 0), loss);
      channel.receive(t, 0.03, 0.001);
      ASSERT_LE(std::abs(channel.trust() - before), 0.05 + 1e-12) << k;
      before = channel.trust();
      if (k < 200) continue;
      mean += channel.trust() / 19800;
      least = std::min(least, channel.trust());
    }
    EXPECT_TRUE(loss > 0 || least == 1);
    EXPECT_TRUE(loss > 0.5 || mean > 0.99) << mean;
    // It grows within 6 ticks of a packet that arrives, 1 - 0.95^6 = 26 % of the time; else it falls.
    EXPECT_TRUE(loss < 0.95 || mean < 0.26) << mean;
  }
}

TEST(TeleoperationChannel, LosesTheShareThatIsAskedForAndTheSameAfterARestart) {
  std::vector<int> arrived[2];
  TeleoperationChannel channel;
  for (auto& run : arrived) {
    channel.start(7);
    for (int k = 0; k < 10000; ++k) {
      const double t = 0.001 * k;
      channel.send(packet(t, 1), 0.3);
      if (channel.receive(t, 0, 0.001) > 0) run.push_back(k);
    }
  }
  EXPECT_EQ(arrived[0], arrived[1]);
  EXPECT_NEAR(static_cast<double>(arrived[0].size()), 7000, 150);  // three standard deviations
}

}  // namespace
}  // namespace multipanda::teleoperation_channel_test
