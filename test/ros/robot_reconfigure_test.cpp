// Random changes of parameters under traffic. Every statistics message must belong to one single
// configuration for its two frames: it is computed again from the frames and compared.

#include <dynamic_reconfigure/Reconfigure.h>
#include <ktgp_orb/KtgpConfig.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>
#include <std_srvs/Trigger.h>

#include <map>
#include <random>

#include "robot_testing.h"
#include "ros/configuration.h"
#include "ros/image_conversion.h"

namespace ktgp_orb {
namespace {

using test::Camera;
using test::Recorder;

constexpr double kRate = 50.0;  // changes per second

/// A random valid change; the ranges limit the time of a frame to milliseconds.
void changeAtRandom(KtgpConfig& config, std::mt19937& random) {
  const auto integer = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  const auto real = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto coin = [&] { return integer(0, 1) == 1; };
  const char* const modes[] = {"previous", "keyframe", "fixed"};
  const std::function<void()> each[] = {
      [&] { config.T_w = real(0.3, 1.0); },
      [&] { config.T_G = real(0.0, 12.0); },
      [&] { config.features = integer(100, 600); },
      [&] { config.scale_factor = real(1.1, 1.6); },
      [&] { config.levels = integer(1, 8); },
      [&] { config.fast_threshold = integer(5, 60); },
      [&] { config.gms_rotation = coin(); },
      [&] { config.gms_scale = coin(); },
      [&] { config.prosac_threshold = real(0.5, 10.0); },
      [&] { config.reference_mode = modes[integer(0, 2)]; },
      [&] { config.threads = integer(0, 2); },
      [&] { config.mutual = coin(); },
  };
  each[integer(0, 11)]();
}

class Reconfigure : public testing::Test {
 protected:
  void SetUp() override {
    ros::param::set("/camera/matcher/features", 300);
    ASSERT_TRUE(test::loadMatcher(loader_, "/camera"));
    client_ = ros::NodeHandle().serviceClient<dynamic_reconfigure::Reconfigure>(
        "/camera/matcher/set_parameters", true);
    ASSERT_TRUE(client_.waitForExistence());
    camera_.keep();
    camera_.start();
    config_.features = 300;
    configurations_.push_back(config_);
    // A reference for fixed mode.
    ASSERT_TRUE(recorder_.waitForMore(2));
    ASSERT_NO_FATAL_FAILURE(send([](KtgpConfig& config) { config.reference_mode = "fixed"; }));
    std_srvs::Trigger fix;
    ASSERT_TRUE(ros::service::call("/camera/matcher/set_reference", fix));
    ASSERT_TRUE(fix.response.success) << fix.response.message;
    ASSERT_TRUE(recorder_.waitForMore(2));
    ASSERT_NO_FATAL_FAILURE(send([](KtgpConfig& config) { config.reference_mode = "previous"; }));
  }

  void change() {
    send([this](KtgpConfig& config) { changeAtRandom(config, random_); });
  }

  /// Sends one change; returns the accepted values.
  void send(const std::function<void(KtgpConfig&)>& change) {
    change(config_);
    dynamic_reconfigure::Reconfigure call;
    config_.__toMessage__(call.request.config);
    ASSERT_TRUE(client_.call(call));
    config_.__fromMessage__(call.response.config);
    configurations_.push_back(config_);
  }

  void expectAsComputedAgain(const MatchStatistics& statistics);
  FramePtr frameAt(const ros::Time& stamp, OrbExtractor& extractor) {
    const auto found = images_.find(stamp);
    return found == images_.end() ? nullptr : makeFrame(found->second, extractor);
  }

  Camera camera_{"/camera/image_raw", {320, 240}, 60.0};
  nodelet::Loader loader_{false};
  Recorder<MatchStatistics> recorder_{"/camera/matcher/statistics"};
  ros::ServiceClient client_;
  std::mt19937 random_{7};
  KtgpConfig config_ = KtgpConfig::__getDefault__();
  std::vector<KtgpConfig> configurations_;  // by number
  std::map<ros::Time, sensor_msgs::ImageConstPtr> images_;
};

void Reconfigure::expectAsComputedAgain(const MatchStatistics& statistics) {
  ASSERT_LT(statistics.configuration, configurations_.size());
  Configuration configuration =
      configurationFrom(configurations_[statistics.configuration], statistics.configuration);
  // The result does not depend on the number of threads; with one, thousands of pools need not be
  // started.
  configuration.sequence.orb.threads = configuration.sequence.matcher.knn.threads = 1;
  OrbExtractor extractor(configuration.sequence.orb);
  const FramePtr target = frameAt(statistics.header.stamp, extractor);
  ASSERT_TRUE(target);
  EXPECT_EQ(statistics.target_features, target->features.size());
  if (statistics.status == MatchStatus::STATUS_NO_REFERENCE) return;
  const FramePtr reference = frameAt(statistics.reference_stamp, extractor);
  ASSERT_TRUE(reference);
  EXPECT_EQ(statistics.reference_features, reference->features.size());
  // A fixed reference is searched near a prediction, which only the node knows.
  if (configuration.sequence.matcher.knn.search_radius > 0.0) return;
  KtgpMatcher matcher(configuration.sequence.matcher);
  MatchResult result;
  matcher.match(reference->features, target->features, result);
  EXPECT_EQ(statistics.status, static_cast<std::uint8_t>(result.status));
  ASSERT_EQ(statistics.stages.size(), result.stages.size());
  for (std::size_t i = 0; i < result.stages.size(); ++i) {
    EXPECT_EQ(statistics.stages[i].input, result.stages[i].input) << toString(result.stages[i].id);
    EXPECT_EQ(statistics.stages[i].output, result.stages[i].output)
        << toString(result.stages[i].id);
  }
}

TEST_F(Reconfigure, EveryMessageIsOfOneConfiguration) {
  const int changes = test::argument("changes", 1000);
  ros::WallRate pace(kRate);
  for (int i = 0; i < changes; ++i) {
    ASSERT_NO_FATAL_FAILURE(change()) << "change " << i;
    pace.sleep();
  }
  ASSERT_TRUE(recorder_.waitForMore(2)) << "the matcher stands still after the changes";
  camera_.stop();
  const auto statistics = recorder_.messages();
  for (const auto& image : camera_.kept()) images_[image->header.stamp] = image;

  std::map<std::uint32_t, int> seen;
  std::size_t matched = 0;
  for (const auto& s : statistics) {
    SCOPED_TRACE("configuration " + std::to_string(s->configuration));
    ASSERT_NO_FATAL_FAILURE(expectAsComputedAgain(*s));
    ++seen[s->configuration];
    matched += s->status != MatchStatus::STATUS_NO_REFERENCE ? 1 : 0;
  }
  EXPECT_EQ(statistics.back()->configuration, configurations_.size() - 1);
  std::printf("%zu messages, %zu of them with a reference, over %zu configurations\n",
              statistics.size(), matched, seen.size());
  EXPECT_GT(seen.size(), configurations_.size() / 10);
  EXPECT_GT(matched, statistics.size() / 4);
}

}  // namespace
}  // namespace ktgp_orb
