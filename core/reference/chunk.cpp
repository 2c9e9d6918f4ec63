#include <algorithm>
#include <cmath>

#include "core/reference/reference.hpp"

// Samples that arrive before they are due: a policy's next actions, replaced by later ones.
namespace multipanda {

Verdict Reference::check(const Chunk& chunk) const {
  if (chunk.count == 0 || chunk.count > Chunk::kMostSamples) return Verdict::wrong_size;
  for (std::size_t k = 0; k < chunk.count; ++k) {
    if (const Verdict verdict = check(chunk.sample(k)); verdict != Verdict::accepted) return verdict;
    if (!std::isfinite(chunk.times_s[k])) return Verdict::not_finite;
    if (k == 0) continue;
    const double gap = chunk.times_s[k] - chunk.times_s[k - 1];
    if (!(gap > 0 && gap <= spec_.timeout_s)) return Verdict::out_of_bounds;
  }
  return Verdict::accepted;
}

Verdict Reference::post(Chunk chunk, std::uint64_t& id) {
  const Verdict verdict = check(chunk);
  if (verdict != Verdict::accepted) return verdict;
  const std::lock_guard lock(inbox_->posters);
  id = inbox_->chunk = chunk.id = inbox_->posted + 1;
  inbox_->posted += chunk.count;
  inbox_->chunks.write(chunk);
  return Verdict::accepted;
}

void Reference::discard(std::uint64_t chunk) {
  const std::lock_guard lock(inbox_->posters);
  if (chunk == 0 || inbox_->chunk != chunk) return;
  inbox_->chunk = 0;
  inbox_->chunks.write({});
}

// --- loop thread ---

void Reference::take_chunk(double now_s) {
  if (inbox_->chunks.take()) {
    const Chunk& chunk = inbox_->chunks.value();
    queued_ = chunk.count;
    for (next_ = 0; next_ < queued_ && chunk.times_s[next_] <= now_s;) ++next_;
    inbox_->late.fetch_add(next_, std::memory_order_relaxed);
  }
  if (next_ < queued_ && inbox_->targets.value().id > inbox_->chunks.value().id) forget_chunk();
}

// Plans the newest of the samples that are due.
void Reference::take_due(double now_s) {
  if (next_ == queued_ || (streaming_ && now_s <= last_arrival_s_)) return;  // a paused loop has no time
  const Chunk& chunk = inbox_->chunks.value();
  const auto due_s = [&](std::size_t k) {
    if (chunk.count == 1) return chunk.times_s[0];
    const std::size_t gap = std::max<std::size_t>(k, 1);
    return chunk.times_s[k] - (chunk.times_s[gap] - chunk.times_s[gap - 1]);
  };
  std::size_t due = next_;
  while (due < queued_ && due_s(due) <= now_s) ++due;
  if (due == next_) return;
  next_ = due;
  // Timed by its own time, which is exact, and after the last one in any case.
  timed_ = true;
  take(chunk.sample(due - 1), std::min(now_s, std::max(due_s(due - 1), last_arrival_s_ + 1e-3)));
  timed_ = false;
  last_.id = chunk.id + chunk.count - 1;  // a sample that is sent now is the next one
}

}  // namespace multipanda
