#pragma once

#include <array>
#include <cstdint>
#include <random>

#include "core/types/spatial.hpp"

namespace multipanda {

// Packet from one side of a teleoperation to the other, in the coordinates of the led hand.
struct TeleoperationPacket {
  double sent_s = 0;            // loop time
  std::uint32_t alignment = 0;  // counts the times the clutch was closed; 0: it is open
  Pose X;                       // leader: its goal for the follower; follower: its hand
  Vector6 V = Vector6::Zero();  // of that pose [m/s, rad/s]
  Vector6 F = Vector6::Zero();  // follower: estimated wrench that it exerts, at its hand [N, N m]
  double energy = 0;            // taken from the sender's tank, for the receiver's [J]
  double tank = 0;              // remaining energy of the sender's tank [J]
};

// One direction of the connection between both sides: packets arrive in order, `delay` after they were sent,
// or never. It never creates energy: the energy that arrives and is in transit is at most what was sent. Loop
// thread, no allocation; the losses are the same after every start().
class TeleoperationChannel {
 public:
  static constexpr double kLongestDelay = 0.2;  // [s]

  void start(std::uint32_t seed);
  // `loss`: the probability that the packet never arrives. Without room it is lost, too.
  void send(const TeleoperationPacket& packet, double loss);
  // Receives all packets due, once per tick of dt. Returns their energy [J].
  double receive(double now_s, double delay_s, double dt);

  bool any() const { return any_; }  // a packet has arrived since start()
  // How far the velocity of the newest packet counts, 0 to 1: it fades while packets are late, so that a
  // faltering channel neither keeps driving nor shakes a hand.
  double trust() const { return trust_; }
  const TeleoperationPacket& newest() const { return newest_; }
  double under_way() const { return under_way_; }  // energy [J]
  double lost() const { return lost_; }            // energy [J]

 private:
  static constexpr std::size_t kCapacity = 512;

  std::array<TeleoperationPacket, kCapacity> ring_;
  std::size_t first_ = 0, count_ = 0;
  TeleoperationPacket newest_;
  bool any_ = false;
  double under_way_ = 0, lost_ = 0, trust_ = 0;
  std::minstd_rand random_;
};

}  // namespace multipanda
