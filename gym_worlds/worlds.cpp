#include <algorithm>
#include <atomic>
#include <cstring>
#include <sstream>
#include <thread>

#include "gym_worlds/world.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

// A C interface for ctypes. Functions return 0, or 1 with a text.
using namespace multipanda;

namespace {

struct Worlds {
  Registry registry;
  std::vector<std::unique_ptr<LearningWorld>> worlds;
  std::vector<std::string> objects, active;
  std::size_t arms = 0, threads = 1;
};

std::vector<std::string> names(const char* text) {
  std::vector<std::string> all;
  std::istringstream in(text);
  for (std::string one; in >> one;) all.push_back(one);
  return all;
}

int failed(char* text, std::size_t size, const std::exception& error) {
  std::strncpy(text, error.what(), size - 1);
  text[size - 1] = 0;
  return 1;
}

// Each world on one thread at a time; what a world computes does not depend on the threads.
template <typename Work>
void each(Worlds& all, const std::uint8_t* mask, Work work) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr wrong;
  std::atomic_flag told = ATOMIC_FLAG_INIT;
  const auto run = [&] {
    for (std::size_t k = next++; k < all.worlds.size(); k = next++) {
      if (mask[k] == 0) continue;
      try {
        work(k, *all.worlds[k]);
      } catch (...) {
        if (!told.test_and_set()) wrong = std::current_exception();
      }
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t t = 1; t < std::min(all.threads, all.worlds.size()); ++t) threads.emplace_back(run);
  run();
  for (auto& thread : threads) thread.join();
  if (wrong) std::rethrow_exception(wrong);
}

}  // namespace

extern "C" {

__attribute__((visibility("default"))) void* mpg_open(const char* scene, int count, const char* objects,
                                                      const char* active, int threads, char* text,
                                                      std::size_t size) {
  try {
    auto opened = open_scene(scene);
    auto all = std::make_unique<Worlds>();
    all->registry = std::move(opened.registry);
    all->objects = names(objects);
    all->active = names(active);
    all->threads =
        threads > 0 ? static_cast<std::size_t>(threads) : std::max(1u, std::thread::hardware_concurrency());
    all->arms = opened.scene.arms.size();
    for (int k = 0; k < count; ++k)
      all->worlds.push_back(std::make_unique<LearningWorld>(opened.scene, all->registry));
    return all.release();
  } catch (const std::exception& error) {
    failed(text, size, error);
    return nullptr;
  }
}

__attribute__((visibility("default"))) void mpg_close(void* handle) { delete static_cast<Worlds*>(handle); }

// q_start: worlds x arms x 7; object_poses: worlds x objects x 7.
__attribute__((visibility("default"))) int mpg_reset(void* handle, const std::uint8_t* mask,
                                                     const std::uint64_t* seeds, int hidden,
                                                     const double* q_start, const double* object_poses,
                                                     char* text, std::size_t size) {
  try {
    auto& all = *static_cast<Worlds*>(handle);
    each(all, mask, [&](std::size_t k, LearningWorld& world) {
      world.reset(seeds[k], hidden != 0, q_start + k * all.arms * 7,
                  object_poses + k * all.objects.size() * LearningWorld::kObjectNumbers, all.objects,
                  all.active);
    });
    return 0;
  } catch (const std::exception& error) {
    return failed(text, size, error);
  }
}

__attribute__((visibility("default"))) int mpg_target(void* handle, const std::uint8_t* mask,
                                                      const char* controllet, const char* name,
                                                      int is_parameter, const double* values, int count,
                                                      char* text, std::size_t size) {
  try {
    auto& all = *static_cast<Worlds*>(handle);
    const auto n = static_cast<std::size_t>(count);
    for (std::size_t k = 0; k < all.worlds.size(); ++k) {
      if (mask[k] == 0) continue;
      if (is_parameter != 0)
        all.worlds[k]->parameter(controllet, name, values + k * n, n);
      else
        all.worlds[k]->target(controllet, name, values + k * n, n);
    }
    return 0;
  } catch (const std::exception& error) {
    return failed(text, size, error);
  }
}

__attribute__((visibility("default"))) void mpg_gripper(void* handle, const std::uint8_t* mask, int arm,
                                                        const double* width_force) {
  auto& all = *static_cast<Worlds*>(handle);
  for (std::size_t k = 0; k < all.worlds.size(); ++k) {
    if (mask[k] != 0)
      all.worlds[k]->gripper(static_cast<std::size_t>(arm), width_force[2 * k], width_force[2 * k + 1]);
  }
}

__attribute__((visibility("default"))) void mpg_user_stop(void* handle, int world, int arm) {
  static_cast<Worlds*>(handle)->worlds[static_cast<std::size_t>(world)]->user_stop(
      static_cast<std::size_t>(arm));
}

// Steps, then writes states: worlds x arms x 35 and worlds x objects x 7, and whether an arm has stopped.
__attribute__((visibility("default"))) int mpg_step(void* handle, const std::uint8_t* mask, int cycles,
                                                    double* arms, double* objects, std::uint8_t* stopped,
                                                    char* text, std::size_t size) {
  try {
    auto& all = *static_cast<Worlds*>(handle);
    each(all, mask, [&](std::size_t k, LearningWorld& world) {
      if (cycles > 0) world.step(static_cast<std::size_t>(cycles));
      world.write_state(arms + k * all.arms * LearningWorld::kArmNumbers,
                        objects + k * all.objects.size() * LearningWorld::kObjectNumbers, all.objects);
      stopped[k] = world.stopped() ? 1 : 0;
    });
    return 0;
  } catch (const std::exception& error) {
    return failed(text, size, error);
  }
}

__attribute__((visibility("default"))) void mpg_reason(void* handle, int world, char* text,
                                                       std::size_t size) {
  const std::string reason = static_cast<Worlds*>(handle)->worlds[static_cast<std::size_t>(world)]->reason();
  std::strncpy(text, reason.c_str(), size - 1);
  text[size - 1] = 0;
}

}  // extern "C"
