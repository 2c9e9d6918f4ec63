// Writes docs/scene_reference.md and config/schemas/scene.json: scene_reference_tool PAGE SCHEMA
#include <fstream>
#include <iostream>

#include "scene/load.hpp"

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: scene_reference_tool PAGE SCHEMA\n";
    return 2;
  }
  const auto registry = multipanda::Registry::with_builtins();
  std::ofstream page(argv[1], std::ios::binary), schema(argv[2], std::ios::binary);
  page << multipanda::scene_reference_markdown(registry);
  schema << multipanda::scene_json_schema(registry);
  return page.flush() && schema.flush() ? 0 : 1;
}
