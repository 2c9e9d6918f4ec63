#include "python_bindings/batch.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <stdexcept>
#include <thread>

#include "scene/build.hpp"

namespace multipanda {

Batch::Batch(const std::string& scene, std::size_t count, std::size_t threads)
    : opened_(open_scene(scene)), layout_(std::make_unique<StateRow>(opened_.scene)), threads_(threads) {
  if (count == 0) throw std::invalid_argument("expected at least one world, found 0");
  refuse_carried_arms(opened_.scene, "a world in this process");
  for (const auto& arm : opened_.scene.arms) {
    if (arm.fci)
      throw std::invalid_argument("arm '" + arm.name +
                                  "' is a real one, and worlds are simulated: remove its key 'fci'");
  }
  if (threads_ == 0) threads_ = std::max(1u, std::thread::hardware_concurrency());
  parts_.emplace(opened_.scene);
  states_.resize(count * layout_->size());
  for (std::size_t k = 0; k < count; ++k)
    worlds_.push_back(std::make_unique<ControlledWorld>(opened_.scene, opened_.registry, *parts_, *layout_));
}

void Batch::reset(std::span<const std::uint8_t> chosen, std::span<const WorldStart> starts) {
  each(chosen, [&](std::size_t k, ControlledWorld& world) { world.reset(starts[k]); });
}

nlohmann::json Batch::request_of(std::size_t k, nlohmann::json request, const OwnNumbers& own) {
  for (const auto& [key, rows] : own) {
    const std::span row(rows.numbers + k * rows.size, rows.size);
    if (row.size() == 1) {
      request[key] = row[0];
    } else {
      request[key] = std::vector<double>(row.begin(), row.end());
    }
  }
  return request;
}

void Batch::command(std::span<const std::uint8_t> chosen, const nlohmann::json& request,
                    const OwnNumbers& own) {
  for (std::size_t k = 0; k < count(); ++k) {
    if (chosen[k] == 0) continue;
    try {
      worlds_[k]->command(request_of(k, request, own));
    } catch (const RequestRefused& refused) {
      worlds_[k]->refuse(refused.what());
    }
  }
}

void Batch::step(std::span<const std::uint8_t> chosen, std::uint64_t cycles) {
  each(chosen, [&](std::size_t, ControlledWorld& world) {
    try {
      world.step(cycles);
    } catch (const std::runtime_error& failed) {  // of this world's physics: the others go on
      world.refuse(failed.what());
    }
  });
}

void Batch::restore(std::size_t k, const SavedWorld& saved) {
  worlds_[k]->restore(saved);
  worlds_[k]->write_state(states_.data() + k * layout_->size());
}

void Batch::each(std::span<const std::uint8_t> chosen,
                 const std::function<void(std::size_t, ControlledWorld&)>& work) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr wrong;
  std::atomic_flag told = ATOMIC_FLAG_INIT;
  const auto run = [&] {
    for (std::size_t k = next++; k < count(); k = next++) {
      if (chosen[k] == 0) continue;
      try {
        work(k, *worlds_[k]);
        worlds_[k]->write_state(states_.data() + k * layout_->size());
      } catch (...) {
        if (!told.test_and_set()) wrong = std::current_exception();
      }
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t t = 1; t < std::min(threads_, count()); ++t) threads.emplace_back(run);
  run();
  for (auto& thread : threads) thread.join();
  if (wrong) std::rethrow_exception(wrong);
}

}  // namespace multipanda
