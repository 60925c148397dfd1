// The order of files that a pattern names.
#include "bag/name_order.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

namespace ktgp_orb::bag {
namespace {

using Names = std::vector<std::string>;

/// `names` stand in their order; they are shuffled before they are sorted.
void expectOrder(const Names& names) {
  Names shuffled = names;
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(1));
  sortByNumbers(shuffled);
  EXPECT_EQ(shuffled, names);
}

TEST(NameOrder, FollowsTheNumbers) {
  expectOrder({"img1.png", "img2.png", "img10.png"});
  expectOrder({"img0009.png", "img10.png", "img0011.png"});
  expectOrder({"-2.5.png", "-2.png", "-0.5.png", "0.png", "0.25.png", "10.png"});
  expectOrder({"t_-10.png", "t_-9.png", "t_+1.png", "t_2.png"});
  expectOrder({"left-2.png", "left-10.png"});  // a hyphen after a word is no sign
  expectOrder({"2024-01-02_03-04-05.5.jpg", "2024-01-02_03-04-06.jpg", "2024-01-10_00-00-00.jpg"});
  expectOrder({"2024.01.02.jpg", "2024.01.10.jpg", "2024.02.01.jpg"});
  expectOrder({"IMG_1.JPG", "img_2.jpg", "IMG_3.Jpg", "img_10.jpg"});
  expectOrder({"a/frame 2.png", "a/frame 10.png", "b/frame 1.png"});
  expectOrder({"photo.png", "photo (1).png", "photo (2).png", "photo (10).png"});
  expectOrder({"bild_1_größe.png", "bild_2_größe.png", "bild_10_größe.png"});
  expectOrder({"é2.png", "é10.png"});
}

// Python's str() of times near zero.
TEST(NameOrder, TakesDecimalsWithoutTheirZerosAndExponents) {
  expectOrder({"0.0.png", "1e-05.png", "0.0333.png", "0.05.png", "0.1.png", "0.9.png", "1.png"});
  expectOrder({"1700000000.005.png", "1700000000.0383.png", "1700000000.05.png",
               "1700000000.0833.png", "1700000000.1.png", "1700000001.png"});
}

// "1.10" is the tenth page of chapter 1, and ROS's nanoseconds without zeros in front.
TEST(NameOrder, TakesCountsAfterAPointWhereAllNamesSaySo) {
  Names pages;
  for (int page = 1; page <= 12; ++page) pages.push_back("book 1." + std::to_string(page) + ".png");
  expectOrder(pages);
  Names stamps;
  for (int i = 0; i < 40; ++i) {
    stamps.push_back("1000." + std::to_string(5000000 + 24000000 * i) + ".png");
  }
  expectOrder(stamps);
}

TEST(NameOrder, OfTimesByTheClockIsRightForAnyRate) {
  std::mt19937 random(3);
  for (int run = 0; run < 50; ++run) {
    const double step = std::uniform_real_distribution<>(0.01, 0.5)(random);
    const int digits = 1 + run % 6;
    Names names;
    std::string last;
    for (int i = 0; i < 60; ++i) {
      std::string text = std::to_string(i * step);
      text = text.substr(0, text.find('.') + 1 + static_cast<std::size_t>(digits));
      while (text.back() == '0' && text[text.size() - 2] != '.') text.pop_back();
      if (text != last) names.push_back(text + ".png");
      last = text;
    }
    expectOrder(names);
  }
}

TEST(NameOrder, OneOddNameMovesNoOther) {
  Names names;
  for (int i = 0; i < 60; ++i)
    names.push_back(std::to_string(5 + i / 8) + "." + std::to_string(125 * (i % 8)) + ".png");
  for (std::string& name : names) {  // decimals without the zeros at their ends
    std::string stem = name.substr(0, name.size() - 4);
    while (stem.back() == '0' && stem[stem.size() - 2] != '.') stem.pop_back();
    name = stem + ".png";
  }
  for (const std::string odd : {"thumbnail.png", "7.250.png", "old 1.10.png"}) {
    Names with = names;
    with.push_back(odd);
    sortByNumbers(with);
    with.erase(std::find(with.begin(), with.end(), odd));
    Names sorted = names;
    sortByNumbers(sorted);
    EXPECT_EQ(with, sorted) << odd;
  }
}

TEST(NameOrder, ReportsNamesThatDiffer) {
  Names names;
  for (int i = 0; i < 30; ++i) names.push_back("run/" + std::to_string(0.5 * i) + ".png");
  EXPECT_TRUE(oddNames(names).empty());
  names.push_back("run/thumbnail.png");
  EXPECT_EQ(oddNames(names), Names{"run/thumbnail.png"});
  EXPECT_TRUE(oddNames({"a.png", "b1.png", "c2.png", "d_3.png"}).empty()) << "none is usual";
  EXPECT_TRUE(oddNames({"left_1.png", "left_2.png", "right_1.png", "right_2.png"}).empty());
}

TEST(NameOrder, DecimalsMayHaveACommaAsFilesOfManyCountriesDo) {
  Names names{"0,05.png", "0,033.png", "0,1.png", "0,067.png", "1,0.png"};
  sortByNumbers(names);
  EXPECT_EQ(names, (Names{"0,033.png", "0,05.png", "0,067.png", "0,1.png", "1,0.png"}));
  Names tiles;  // row and column
  for (const char* tile : {"1,10", "1,2", "1,20", "1,3", "2,1"}) tiles.emplace_back(tile);
  sortByNumbers(tiles);
  EXPECT_EQ(tiles, (Names{"1,2", "1,3", "1,10", "1,20", "2,1"}));
}

TEST(NameOrder, SeriesThatAlternateAreNamed) {
  Names pairs, copies, apart;
  for (int i = 1; i <= 12; ++i) {
    const std::string number = std::to_string(i);
    for (const char* side : {"_left.png", "_right.png"}) pairs.push_back(number + side);
    for (const char* copy : {".jpg", " (1).jpg"}) copies.push_back("img" + number + copy);
    for (const char* side : {"left_", "right_"}) apart.push_back(side + number + ".png");
  }
  for (Names* const names : {&pairs, &copies, &apart}) sortByNumbers(*names);
  EXPECT_EQ(alternatingNames(pairs), (Names{"1_left.png", "1_right.png"}));
  EXPECT_EQ(alternatingNames(copies).size(), 2u);
  EXPECT_TRUE(alternatingNames(apart).empty());
  EXPECT_TRUE(alternatingNames({"1.png", "2.png", "thumbnail.png", "3.png"}).empty());
}

}  // namespace
}  // namespace ktgp_orb::bag
