// A build without Clp: this program compiles the files that know of it without it. Only the path
// over the whole recording needs a solver; what is refused says so, and what to do instead.
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

#include "stabilization/linear_program.h"
#include "stabilization/steady_path.h"
#include "tools/view_options.h"

namespace ktgp_orb {

bool hasSteadyPath() {  // as in steady_path.cpp
  return stabilization::hasLinearProgram();
}

namespace {

/// The message of the error for these arguments of ktgp_bag; empty if there is none.
std::string errorFor(const std::string& arguments) {
  CLI::App app;
  ViewOptions views;
  addViewOptions(app, views);
  app.parse(arguments);
  try {
    completeViewOptions(app, views, false);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(WithoutClp, OnlyThePathOverTheWholeRecordingIsRefused) {
  EXPECT_EQ(
      errorFor("--stabilize steady.mp4"),
      "--stabilize needs a solver for the path over the whole recording, and this program was "
      "built without Clp (Debian's coinor-libclp-dev); expected --stabilizer_lag N, for example "
      "30, or a build with it");
  EXPECT_EQ(errorFor("--stabilize steady.mp4 --stabilizer_lag 30"), "");
  EXPECT_EQ(errorFor("--stabilize steady.mp4 --stabilizer_lag 0"), "");
  EXPECT_EQ(errorFor("--mosaic map.png"), "");
  EXPECT_EQ(errorFor(""), "");
}

TEST(WithoutClp, TheSolverSaysWhatIsMissing) {
  stabilization::LinearProgram program;
  program.addVariable(0.0, 1.0, 1.0);
  try {
    program.solve();
    FAIL() << "solved without a solver";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("coinor-libclp-dev"), std::string::npos);
  }
}

}  // namespace
}  // namespace ktgp_orb
