#include <algorithm>
#include <malloc.h>
#include <string>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/program.hpp"

// The program `multipanda`: commands that run scenes, and their tools. Other commands start other programs.
namespace multipanda::cli {
namespace {

// Commands of multipanda-lab that also work without `lab`.
constexpr const char* kLabWords[] = {
    "bench", "commission", "communication-test", "compare", "doctor",  "excite", "experiment",
    "fit",   "generate",   "identify",           "observe", "predict", "refine", "soak",
    "study", "via-points"};

void add_lab(Program& program) {
  program.app.add_subcommand("lab", fmt::format("Experiments, identification, commissioning and more: {}",
                                                fmt::join(kLabWords, ", ")));
}

}  // namespace
}  // namespace multipanda::cli

int main(int argc, char** argv) {
  using namespace multipanda::cli;
  // malloc would give each thread an arena of its own, 132 kB of locked memory. The loop, which never
  // allocates, waits for none.
  (void)mallopt(M_ARENA_MAX, 1);
  const std::string word = argc > 1 ? argv[1] : "";
  if (word == "lab") return become("multipanda-lab", argv + 1);
  if (std::ranges::find(kLabWords, word) != std::end(kLabWords)) {
    if (isatty(STDERR_FILENO) == 1) fmt::print(stderr, "multipanda: {0} is now `multipanda lab {0}`\n", word);
    return become("multipanda-lab", argv);
  }
  return run_program(
      argc, argv,
      {.name = "multipanda",
       .description = "multipanda controls any number of torque-controlled arms from one process at 1 kHz.\n"
                      "Every command has its own --help with examples.",
       .footer = "Exit codes: 0 success; 1 run failed; 2 invalid arguments or a refused scene.\n"
                 "Examples:\n"
                 "  multipanda demo\n"
                 "  multipanda run two_arms --seconds 10 --record runs\n"
                 "  multipanda list scenes"},
      {add_demo, add_run, add_move, add_ctl, add_check, add_new, add_arm, add_law, add_list, add_cockpit,
       add_report, add_repair, add_export, add_virtual_arm, add_bridge, add_docs, add_lab});
}
