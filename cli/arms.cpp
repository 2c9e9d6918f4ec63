#include <malloc.h>

#include "cli/program.hpp"

// The program `multipanda` for arms alone (-DMULTIPANDA_SIMULATOR=OFF), in place of main.cpp.
int main(int argc, char** argv) {
  using namespace multipanda::cli;
  (void)mallopt(M_ARENA_MAX, 1);  // as in main.cpp
  return run_program(
      argc, argv,
      {.name = "multipanda",
       .description = "multipanda controls any number of torque-controlled arms from one process "
                      "at 1 kHz: the program for arms alone.\n"
                      "Every command has its own --help with examples.",
       .footer = "Simulation, pages, experiments and ROS 2 are in the package multipanda.\n"
                 "Exit codes: 0 success; 1 run failed; 2 invalid arguments or a refused scene."},
      {add_run, add_move, add_ctl, add_check, add_new, add_arm, add_law, add_list, add_repair, add_export,
       add_bridge, add_docs});
}
