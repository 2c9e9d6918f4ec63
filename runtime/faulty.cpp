#include "runtime/faulty.hpp"

#include <limits>
#include <stdexcept>

namespace multipanda {
namespace {

enum Parameter : std::size_t { kAfter, kFault };
enum class Fault : std::size_t { nan, infinity, implausible, exception, report };

class Faulty final : public Controllet {
 public:
  LawResult start(ControlContext&) override {
    running_s_ = 0;
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    *arm.tau = arm.terms->c() - kDamping * arm.dq();
    running_s_ += context.dt;
    if (running_s_ < context.parameters->number(kAfter)) return LawResult::ok;
    switch (static_cast<Fault>(context.parameters->choice(kFault))) {
      case Fault::nan:
        (*arm.tau)[0] = std::numeric_limits<double>::quiet_NaN();
        return LawResult::ok;
      case Fault::infinity:
        (*arm.tau)[0] = std::numeric_limits<double>::infinity();
        return LawResult::ok;
      case Fault::implausible:
        (*arm.tau)[0] = 1e9;
        return LawResult::ok;
      case Fault::exception:
        throw std::runtime_error("faulty, as asked");
      case Fault::report:
        break;
    }
    return LawResult::fault;
  }

 private:
  static constexpr double kDamping = 0.1;  // [N m s/rad]; stable at 1 kHz on the lightest joint
  double running_s_ = 0;
};

}  // namespace

ControlletType faulty_controllet() {
  return {{.type = "faulty",
           .doc = "Misbehaves on purpose some time after its start: shows what the safety stage does.",
           .inputs = {},
           .parameters = {{"after_s", "s", 1, {0.5}, 0, 1e6, "Time from its start to the fault."},
                          {.name = "fault",
                           .unit = "",
                           .size = 1,
                           .initial = {0},
                           .min = 0,
                           .max = 4,
                           .doc = "What it does then.",
                           .choices = {"nan", "infinity", "implausible", "exception", "report"}}},
           .outputs = {}},
          [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<Faulty>(); }};
}

}  // namespace multipanda
