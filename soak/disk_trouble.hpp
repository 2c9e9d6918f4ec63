#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "logs/recorder.hpp"

namespace multipanda {

// A log that is written while its disk is full, or while nobody takes its records. The loop's side of it must
// not notice: every record is either taken or counted as lost.
class DiskTrouble {
 public:
  // Files lie in `folder` and are removed again.
  DiskTrouble(std::filesystem::path folder, RecordLayout layout);
  ~DiskTrouble();
  DiskTrouble(const DiskTrouble&) = delete;

  // Begins a log; nothing, if one is being written.
  void begin(double at_s, bool full, double lasts_s);
  void take(const CycleRecord& cycle);  // after every cycle
  bool is_writing() const { return ring_ != nullptr; }
  // Reports, since the last call, what was wrong with a closed log, such as records neither written
  // nor counted.
  std::vector<std::string> take_findings() { return std::exchange(findings_, {}); }
  std::uint64_t written() const { return written_; }
  std::uint64_t lost() const { return lost_; }  // and counted

 private:
  void end();
  std::filesystem::path file_;
  RecordLayout layout_;
  std::unique_ptr<RecordRing> ring_;
  std::unique_ptr<Recorder> recorder_;
  bool full_ = false;
  double ends_s_ = 0;
  std::uint64_t cycles_ = 0, written_ = 0, lost_ = 0;
  std::vector<std::string> findings_;
};

}  // namespace multipanda
