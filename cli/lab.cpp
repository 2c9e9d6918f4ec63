#include <string>

#include "cli/program.hpp"

// The program `multipanda-lab`: series of runs and their evaluation. `multipanda lab COMMAND` starts it.
int main(int argc, char** argv) {
  using namespace multipanda::cli;
  const std::string word = argc > 1 ? argv[1] : "";
  if (word == "bench") return become("multipanda_bench", argv + 1);
  if (word == "soak") return become("multipanda-soak", argv);
  return run_program(
      argc, argv,
      {.name = "multipanda lab",
       .description = "Experiments, identification and commissioning with multipanda. Every command has "
                      "its own --help with examples.",
       .footer = "bench and soak have programs of their own.\n"
                 "Examples:\n"
                 "  multipanda lab experiment task-1 --fast\n"
                 "  multipanda lab doctor\n"
                 "Exit codes: 0 success; 1 run failed; 2 invalid arguments or a refused scene."},
      {add_experiment, add_study, add_compare, add_excite, add_identify, add_predict, add_observe, add_fit,
       add_refine, add_commission, add_doctor, add_communication_test, add_generate, add_via_points});
}
