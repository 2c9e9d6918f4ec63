// Writes docs/scene_reference.md: scene_reference_tool FILE
#include <fstream>
#include <iostream>

#include "scene/scene_reference.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: scene_reference_tool FILE\n";
    return 2;
  }
  std::ofstream out(argv[1], std::ios::binary);
  out << multipanda::scene_reference_markdown(multipanda::Registry::with_builtins());
  return out.flush() ? 0 : 1;
}
