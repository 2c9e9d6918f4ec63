// Scene files with seeded damage: any text is read, or refused with a ConfigError; nothing else happens.
#include <fstream>
#include <random>
#include <sstream>

#include <gtest/gtest.h>

#include "scene/load.hpp"

namespace multipanda::load_fuzz_test {
namespace {

std::string file_text(const std::string& name) {
  std::ifstream in(scenes_folder() + "/" + name + ".yaml");
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::string damaged(std::string text, std::mt19937& random) {
  static const std::vector<std::string> pieces{
      ":",    ": ",   "- ",   "[",    "]",    "{",      "}",  "\n",   "  ",       "#",     "'",
      "\"",   "&a ",  "*a",   "!!x ", "|",    ">",      "~",  ".nan", "-.inf",    "1e999", "-1",
      "null", "true", "pi/0", "0x1f", "name", "arms: ", "\t", "\x01", "\xff\xfe", "---\n", "<<: *a"};
  const auto below = [&](std::size_t n) {
    return std::uniform_int_distribution<std::size_t>(0, n - 1)(random);
  };
  const std::size_t changes = 1 + below(4);
  for (std::size_t i = 0; i < changes && !text.empty(); ++i) {
    const std::size_t at = below(text.size()),
                      length = 1 + below(std::min<std::size_t>(40, text.size() - at));
    switch (below(4)) {
      case 0:
        text.erase(at, length);
        break;
      case 1:
        text.insert(at, pieces[below(pieces.size())]);
        break;
      case 2:
        text.replace(at, length, pieces[below(pieces.size())]);
        break;
      default:
        text.insert(below(text.size()), text.substr(at, length));
        break;
    }
  }
  return text;
}

TEST(LoadFuzz, DamagedFilesAreReadOrRefused) {
  std::mt19937 random(20240607);
  const Registry registry = Registry::with_builtins();
  std::vector<std::string> texts;
  for (const auto& name : available_scenes()) texts.push_back(file_text(name));
  ASSERT_FALSE(texts.empty());
  std::size_t read = 0, refused = 0;
  constexpr int kTrials = 300;
  for (int i = 0; i < kTrials; ++i) {
    const std::string text = damaged(texts[static_cast<std::size_t>(i) % texts.size()], random);
    try {
      (void)parse_scene(text, "fuzz.yaml", registry);
      ++read;
    } catch (const ConfigError& error) {
      ++refused;
      EXPECT_EQ(std::string(error.what()).rfind("fuzz.yaml", 0), 0u) << error.what();
    } catch (const std::exception& error) {
      FAIL() << "not a ConfigError: " << error.what() << "\n" << text;
    }
  }
  // Damage in a comment is harmless; but if nothing or everything were refused, the test would be void.
  EXPECT_GT(read, 5u);
  EXPECT_GT(refused, 100u);
}

TEST(LoadFuzz, HostileShapesAreRefused) {
  const Registry registry = Registry::with_builtins();
  const auto refused = [&](const std::string& text) {
    EXPECT_THROW(parse_scene(text, "fuzz.yaml", registry), ConfigError) << text.substr(0, 60);
  };
  refused(std::string(100000, '['));
  refused("arms: &a [*a]\n");
  refused("&a {arms: *a}\n");
  refused("arms: [{name: &n left, base: {position_m: &p [*p, *p, *p]}}]\n");
  refused("? [a, b]\n: 1\n");
  refused(std::string(1 << 21, ' '));
  refused(std::string("arms:\n  - {name: a\0b}\n", 22));
}

}  // namespace
}  // namespace multipanda::load_fuzz_test
