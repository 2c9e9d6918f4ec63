// A library with a law that computes for as long as its parameter says: a computing time that is known.
#include <time.h>

#include "core/controllets/controllet.hpp"
#include "core/plugin/plugin.hpp"

namespace {

using namespace multipanda;

// tau = C dq, after `busy_us` of this thread's CPU time.
class BusyLaw final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {
        .type = "busy",
        .doc = "Computes for a given time.",
        .parameters = spec_table<kParameterCount>(parameter_at<kBusy>({.name = "busy_us",
                                                                       .unit = "us",
                                                                       .initial = {0.0},
                                                                       .max = 900,
                                                                       .doc = "CPU time of an update."}))};
  }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    const double end = cpu_us() + context.parameters->number(kBusy);
    while (cpu_us() < end) {
    }
    *context.arms[0].tau = context.arms[0].terms->c();
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kBusy, kParameterCount };
  static double cpu_us() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
  }
};

}  // namespace

MULTIPANDA_PLUGIN(registry) { registry.add(controllet_type<BusyLaw>()); }
