#include "nodelet/opencv_pool.h"

#include <mutex>
#include <opencv2/core/utility.hpp>

namespace ktgp_orb {
namespace {

std::mutex entrance;  // held by a waiting limit(), so that users that keep coming cannot starve it
std::shared_mutex in_use;

}  // namespace

void OpencvPool::limit(int threads) {
  const std::lock_guard<std::mutex> nobody_enters(entrance);
  const std::lock_guard<std::shared_mutex> nobody_uses(in_use);
  cv::setNumThreads(threads > 0 ? threads : -1);
}

OpencvPool::Use::Use() {
  const std::lock_guard<std::mutex> enter(entrance);
  lock_ = std::shared_lock<std::shared_mutex>(in_use);
}

}  // namespace ktgp_orb
