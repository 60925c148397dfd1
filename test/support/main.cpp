// The main function of the test programs. Each has the tests of many source files:
// --file=NAME runs those of NAME.cpp; without it, all run.

#include <gtest/gtest.h>

#include <cstdio>
#include <string>

namespace {

/// A filter for gtest with the tests of NAME.cpp; empty if there are none.
std::string testsOf(const std::string& name) {
  const std::string end = "/" + name + ".cpp";
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  std::string filter;
  for (int s = 0; s < program.total_test_suite_count(); ++s) {
    const testing::TestSuite& suite = *program.GetTestSuite(s);
    for (int t = 0; t < suite.total_test_count(); ++t) {
      const testing::TestInfo& test = *suite.GetTestInfo(t);
      const std::string file = std::string("/") + test.file();
      if (file.size() < end.size() || file.substr(file.size() - end.size()) != end) continue;
      filter += std::string(suite.name()) + '.' + test.name() + ':';
    }
  }
  return filter;
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  if (argc == 1) return RUN_ALL_TESTS();
  const std::string argument = argv[1];
  const std::string option = "--file=";
  if (argc > 2 || argument.compare(0, option.size(), option) != 0) {
    std::fprintf(stderr, "%s: unknown option; expected --file=NAME\n", argument.c_str());
    return 2;
  }
  const std::string filter = testsOf(argument.substr(option.size()));
  if (filter.empty()) {
    std::fprintf(stderr, "%s: no file of this program with tests has this name\n",
                 argument.c_str());
    return 2;
  }
  testing::GTEST_FLAG(filter) = filter;
  return RUN_ALL_TESTS();
}
