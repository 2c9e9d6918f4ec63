#include "soak/disk_trouble.hpp"

#include <csignal>
#include <sys/resource.h>

#include <fmt/format.h>

namespace multipanda {
namespace {

constexpr std::size_t kRing = 500;      // records; few, so that it overflows
constexpr rlim_t kFullAt = 256 * 1024;  // bytes

void limit_files(rlim_t bytes) {
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  limit.rlim_cur = std::min(bytes, limit.rlim_max);
  setrlimit(RLIMIT_FSIZE, &limit);
}

}  // namespace

DiskTrouble::DiskTrouble(std::filesystem::path folder, RecordLayout layout)
    : file_(std::move(folder) / "disk_trouble.mcap"), layout_(std::move(layout)) {
  std::signal(SIGXFSZ, SIG_IGN);  // a write beyond the limit is an error, as on a full disk
}

DiskTrouble::~DiskTrouble() { end(); }

void DiskTrouble::begin(double at_s, bool full, double lasts_s) {
  if (ring_) return;
  ring_ = std::make_unique<RecordRing>(layout_, kRing);
  full_ = full;
  cycles_ = 0;
  ends_s_ = at_s + lasts_s;
  if (full) {
    limit_files(kFullAt);
    recorder_ = std::make_unique<Recorder>(file_, layout_, *ring_,
                                           std::vector<RecordedArm>(layout_.arms.size()), RecorderOptions{});
  }
}

void DiskTrouble::take(const CycleRecord& cycle) {
  if (!ring_) return;
  ++cycles_;
  if (!ring_->ring.push(cycle)) ring_->dropped_records.fetch_add(1, std::memory_order_relaxed);
  if (cycle.t.seconds() >= ends_s_) end();
}

void DiskTrouble::end() {
  if (!ring_) return;
  limit_files(RLIM_INFINITY);
  // On the slow disk the writer comes only now, to what is left.
  if (!recorder_)
    recorder_ = std::make_unique<Recorder>(file_, layout_, *ring_,
                                           std::vector<RecordedArm>(layout_.arms.size()), RecorderOptions{});
  const RecorderStatus status = recorder_->stop();
  if (status.cycles + status.cycles_lost != cycles_)
    findings_.push_back(fmt::format("of {} records {} were taken and {} counted as lost", cycles_,
                                    status.cycles, status.cycles_lost));
  if (cycles_ > 2 * kRing && status.missing().empty())
    findings_.push_back("a log is incomplete, and its recorder says that nothing is missing");
  written_ += status.cycles;
  lost_ += status.cycles_lost;
  recorder_.reset();
  ring_.reset();
  std::error_code error;
  std::filesystem::remove(file_, error);
}

}  // namespace multipanda
