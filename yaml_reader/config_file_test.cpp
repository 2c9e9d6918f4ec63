#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "yaml_reader/archive.hpp"
#include "yaml_reader/config_error.hpp"
#include "yaml_reader/reference_page.hpp"

namespace multipanda::config_file_test {
namespace {

using testing::HasSubstr;

struct Wheel {
  std::string name;
  double diameter = 0.2;
};
enum class Color { red, blue };
struct Cart {
  double speed = 1.5;
  std::size_t seats = 2;
  bool roof = false;
  Color color = Color::red;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  std::optional<double> load;
  std::vector<Wheel> wheels;
};

void visit(Archive& archive, Wheel& wheel) {
  archive.about("Wheel", "One wheel.");
  archive(Key("name", "Unique name.").identifier().required(), wheel.name);
  archive(Key("diameter_m", "Diameter.").above(0).at_most(2), wheel.diameter);
}

void visit(Archive& archive, Cart& cart) {
  archive.about("Cart", "The top level of the file.");
  archive.collect();
  archive(Key("speed_m_per_s", "Largest speed.").at_least(0), cart.speed);
  archive(Key("seats", "Number of seats."), cart.seats);
  archive(Key("roof", "Has a roof."), cart.roof);
  archive(Key("color", "Color.").one_of({"red", "blue"}), cart.color);
  archive(Key("position_m", "Place."), cart.position);
  archive(Key("load_kg", "Load. Default: none."), cart.load);
  archive.list(Key("wheels", "Wheels.").each("wheel").required(), cart.wheels);
}

Cart read(const std::string& text) {
  Cart cart;
  Archive::read(Node::parse(text, "cart.yaml"), cart);
  return cart;
}

std::string error_of(const std::string& text);

TEST(Errors, OfItemsAndUnknownKeysAreNamedTogether) {
  const std::string found = error_of(R"(
wheels:
  - {name: front, diameter_m: 3}
  - {name: back, diametre_m: 1, color: red}
  - {name: spare}
  - {name: 2 x}
)");
  EXPECT_THAT(found, testing::StartsWith("cart.yaml:3: wheel 'front': diameter_m: "));
  EXPECT_THAT(found, HasSubstr("\ncart.yaml:4: wheel 2: unknown key 'diametre_m'"));
  EXPECT_THAT(found, HasSubstr("\ncart.yaml:4: wheel 2: unknown key 'color'"));
  EXPECT_THAT(found, HasSubstr("\ncart.yaml:6: wheel 4: name: "));
  EXPECT_EQ(std::ranges::count(found, '\n'), 3);
  // Not the empty list that follows from them.
  EXPECT_EQ(error_of("wheels: [{name: a, diameter_m: 5}]").find('\n'), std::string::npos);
}

std::string error_of(const std::string& text) {
  try {
    (void)read(text);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ConfigFile, ReadsWhatIsWrittenAndKeepsDefaults) {
  const Cart cart = read(
      "speed_m_per_s: 3\ncolor: blue\nposition_m: [1, pi, 3]\nload_kg: 4\n"
      "wheels: {left: {diameter_m: 0.5}, right: }\n");
  EXPECT_EQ(cart.speed, 3);
  EXPECT_EQ(cart.seats, 2u);
  EXPECT_EQ(cart.color, Color::blue);
  EXPECT_EQ(cart.position.z(), 3);
  EXPECT_EQ(cart.load, 4);
  ASSERT_EQ(cart.wheels.size(), 2u);
  EXPECT_EQ(cart.wheels[0].diameter, 0.5);
  EXPECT_EQ(cart.wheels[1].name, "right");
  EXPECT_FALSE(read("wheels: []\n").load);
}

TEST(ConfigFile, ErrorsNameLineExpectationAndNearestName) {
  EXPECT_THAT(error_of("whels: []\n"), HasSubstr("cart.yaml:1: unknown key 'whels'; did you mean 'wheels'?"));
  EXPECT_THAT(error_of("seats: 1\n"), HasSubstr("the key 'wheels' is missing"));
  EXPECT_THAT(error_of("speed_km_h: 3\nwheels: []\n"), HasSubstr("unknown key"));
  EXPECT_THAT(error_of("wheels: []\nload: 1\n"),
              HasSubstr("cart.yaml:2: unknown key 'load': a key names its unit; write 'load_kg' [kg]"));
  EXPECT_THAT(error_of("wheels: []\nposition_m: [1, 2]\n"),
              HasSubstr("position_m: expected a list of 3 numbers [m], found a list of 2"));
  EXPECT_THAT(
      error_of("wheels:\n  - {name: a}\n  - {name: b, diameter_m: 0}\n"),
      HasSubstr(
          "cart.yaml:3: wheel 'b': diameter_m: expected a number [m], above 0 and at most 2, found '0'"));
  EXPECT_THAT(error_of("wheels: []\nwheels: []\n"),
              HasSubstr("duplicate key 'wheels', first in line 1; remove one"));
  EXPECT_THAT(error_of("wheels: []\ncolor: bleu\n"), HasSubstr("did you mean 'blue'?"));
  EXPECT_THAT(error_of("wheels: []\nroof: yes\n"), HasSubstr("expected true or false, found 'yes'"));
}

// An alias is the anchor's own node: what is read for one name must not stick to the other.
TEST(ConfigFile, AliasesAreReadUnderTheirOwnNames) {
  const std::string written = "wheels:\n  left: &wheel {diameter_m: 0.5}\n  right: *wheel\n  spare: *wheel\n";
  for (int reading = 0; reading < 2; ++reading) {
    const Cart cart = read(written);
    ASSERT_EQ(cart.wheels.size(), 3u);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(cart.wheels[i].name, (std::array{"left", "right", "spare"}[i]));
      EXPECT_EQ(cart.wheels[i].diameter, 0.5);
    }
  }
  // Reading twice from one document.
  const Node document = Node::parse(written, "cart.yaml");
  Cart first, second;
  Archive::read(document, first);
  Archive::read(document, second);
  EXPECT_EQ(second.wheels[1].name, "right");
  // In a list; an alias of a value; an error below an alias is in the alias's line.
  EXPECT_EQ(read("wheels:\n  - &a {name: a, diameter_m: &d 0.3}\n  - {name: b, diameter_m: *d}\n")
                .wheels[1]
                .diameter,
            0.3);
  EXPECT_THAT(error_of("wheels:\n  left: &wheel {diameter_m: 0.5, name: left}\n  right: *wheel\n"),
              HasSubstr("cart.yaml:3: wheel 'right': name: the key of this section names it 'right'"));
}

TEST(ConfigFile, DuplicatesAmongThousandsOfKeys) {
  constexpr int kNames = 20000;
  std::string text = "wheels:\n";
  for (int i = 0; i < kNames; ++i) text += "  w" + std::to_string(i) + ":\n";
  const Cart cart = read(text);
  ASSERT_EQ(cart.wheels.size(), static_cast<std::size_t>(kNames));
  EXPECT_EQ(cart.wheels.back().name, "w19999");
  EXPECT_THAT(error_of(text + "  w12345:\n"),
              HasSubstr("cart.yaml:20002: wheels: duplicate key 'w12345', first in line 12347; remove one"));

  // Comparisons per name: twice the height of a balanced tree (log2 of 20,000 is 14.3), not thousands.
  static std::size_t comparisons = 0;
  struct Counted {
    bool operator()(const std::string& a, const std::string& b) const {
      ++comparisons;
      return a < b;
    }
  };
  FirstLines<Counted> lines;
  for (int i = 0; i < kNames; ++i) ASSERT_FALSE(lines.add("w" + std::to_string(i), i + 2));
  EXPECT_EQ(lines.add("w7", 0), 9);
  EXPECT_LE(comparisons, 40u * kNames);
}

TEST(ConfigFile, DescribesTheSameKeys) {
  const auto section = Archive::describe<Cart>();
  const std::string page = reference_lists(*section);
  EXPECT_THAT(page, HasSubstr("- `speed_m_per_s` ([m/s], at least 0; default `1.5`): Largest speed.\n"));
  EXPECT_THAT(page, HasSubstr("- `wheels` (list of [Wheel](#wheel); **required**): Wheels.\n"));
  EXPECT_THAT(page, HasSubstr("## Wheel"));

  const auto schema = json_schema(*section, "cart");
  const auto& cart = schema["definitions"]["Cart"];
  EXPECT_EQ(cart["required"].dump(), "[\"wheels\"]");
  EXPECT_EQ(cart["properties"]["speed_m_per_s"]["minimum"], 0);
  EXPECT_EQ(cart["properties"]["color"]["enum"].dump(), "[\"red\",\"blue\"]");
  EXPECT_EQ(cart["properties"]["position_m"]["minItems"], 3);
  EXPECT_FALSE(cart["properties"]["load_kg"].contains("default"));
  EXPECT_EQ(cart["properties"]["wheels"]["anyOf"].size(), 2u);
}

TEST(ConfigFile, AnItemOfAListAboveIsOnlyNamed) {
  PageLists lists;
  EXPECT_EQ(lists.list("First one", {{"`a`", ": x"}, {"`b`", ": y"}}), "\n- `a`: x\n- `b`: y\n");
  EXPECT_EQ(lists.list("c_d", {{"`a`", ": x"}, {"`b`", ": other"}, {"`b`", ": y"}}),
            "\n- `b`: other\n- as in [First one](#first-one): `a`, `b`\n");
  EXPECT_EQ(lists.list("e", {{"`b`", ": other"}}), "\n- as in [c_d](#c_d): `b`\n");
  EXPECT_EQ(lists.list("f", {}), "");
}

}  // namespace
}  // namespace multipanda::config_file_test
