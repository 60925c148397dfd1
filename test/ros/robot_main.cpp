// The main() of the programs that load nodelets into their own process.

#include "robot_testing.h"

int main(int argc, char** argv) {
  const std::string path = argv[0];
  return ktgp_orb::test::runTests(argc, argv, path.substr(path.rfind('/') + 1));
}
