#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <thread>

#include "core/rt/triple_buffer.hpp"
#include "core/state/force_sensor.hpp"
#include "core/types/time.hpp"

namespace multipanda::fci {

// An ATI Net F/T, or another device with its Raw Data Transfer over UDP (RDT), as in ATI's manual
// 9620-05-NET FT. A request of 8 bytes: header 0x1234, command (2: stream, 0: stop), sample count (0: no
// end). A record of 36: numbers of the record in the stream and of the sample in the device, status, then
// Fx Fy Fz Tx Ty Tz in counts. All big-endian. The device streams up to 7000 records per second.
//
// A thread of its own reads the records and hands the newest to the loop. It asks again when the device is
// silent. Late and repeated records, by the sample's number, are dropped. The number counts from the device's
// start: one far below the last one, beyond what it can have counted since, or so small that it may have
// begun since, means that the device was restarted. Its own settings may have changed, so it stays a fault
// until start().
class NetFt {
 public:
  struct Config {
    std::string who;      // for messages: "arm left: force sensor"
    std::string address;  // IPv4 address or host name
    std::uint16_t port = 49152;
    double counts_per_n = 1e6, counts_per_nm = 1e6;  // as configured on the device
    std::function<void(const std::string&)> report;  // from its thread; empty: none
  };
  static constexpr double kAgain = 0.25;  // silence before it asks again [s]

  explicit NetFt(Config config);
  ~NetFt();  // stops
  NetFt(const NetFt&) = delete;

  // Waits for the first mean of SensedForce::kTareTime. Throws std::runtime_error: no answer.
  void start();
  void stop();  // ends the stream and the thread

  // Loop thread: the newest record and its present age.
  const ForceReading& latest() noexcept;
  std::uint64_t foreign() const { return foreign_.load(std::memory_order_relaxed); }  // datagrams, ignored
  std::uint64_t late() const { return late_.load(std::memory_order_relaxed); }        // records, dropped

 private:
  struct Stamped {
    ForceReading reading;
    HostTime received;
  };
  void ask(std::uint16_t command) const;
  void run();
  void take(const unsigned char* record, HostTime now);
  void average(HostTime now);
  void tell(const std::string& what) const;

  Config config_;
  int socket_ = -1;
  std::thread thread_;
  std::atomic<bool> ending_{false}, ready_{false};
  std::atomic<std::uint64_t> foreign_{0}, late_{0};
  TripleBuffer<Stamped> newest_;
  ForceReading seen_;  // loop thread

  // Reading thread
  Stamped last_;
  std::uint32_t sample_ = 0, status_ = 0;
  bool restarted_ = false, silent_ = false;
  Vector6 sum_;
  int summed_ = 0;
  HostTime sum_began_;
};

}  // namespace multipanda::fci
