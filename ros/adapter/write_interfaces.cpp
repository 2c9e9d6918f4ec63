// Updates the tables of docs/ros_interfaces.md: `ros_interfaces_tool PAGE`.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <sstream>
#include <string>

#include "ros/adapter/interfaces_page.hpp"

int main(int argc, char** argv) try {
  if (argc != 2) throw std::invalid_argument("usage: ros_interfaces_tool PAGE");
  std::ifstream in(argv[1]);
  std::ostringstream before;
  before << in.rdbuf();
  const std::string page =
      multipanda::ros::with_tables(before.str(), multipanda::ros::scene_interface_tables("two_arms"));
  std::ofstream(argv[1]) << page;
  return EXIT_SUCCESS;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return EXIT_FAILURE;
}
