#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace ktgp_orb::estimation {

/// Degrees of freedom of Student's t distribution; 4 gave the best results for keypoints of real
/// images.
inline constexpr double kStudentFreedom = 4.0;

/// The weight of a measurement in a maximum likelihood fit with Student's t distribution (Lange,
/// Little & Taylor, JASA 1989). `square`: squared error of the measurement; `scale2`: squared scale
/// of the errors; `dimensions`: d, the number of residuals of the measurement. With f =
/// kStudentFreedom, the weight is (f + d) / (f + square / scale2); it is 1 if square = d scale2.
/// The fit treats the measurement as if its variance were larger by the factor 1 / weight.
template <typename Value>
Value studentWeight(const Value& square, double scale2, double dimensions) {
  return (kStudentFreedom + dimensions) * scale2 / (kStudentFreedom * scale2 + square);
}

/// Errors and weights of n measurements, which have d residuals each, and the scale of the errors.
/// Reuses its buffers from call to call. The arrays are padded to a multiple of `kLanes` entries;
/// the padding must have weight 0.
class RobustWeights {
 public:
  static constexpr std::size_t kLanes = 2;

  /// Begins a fit. `n`: number of measurements; `dimensions`: residuals per measurement (d);
  /// `parameters`: number of fitted parameters. All measurements get the factor 1.
  void reset(std::size_t n, int dimensions, std::size_t parameters);
  /// Sets the factors c (n entries, mean 1) by which the weights t of Student's distribution are
  /// multiplied, so that some measurements count more than others. `equal`: the number that
  /// equalMeasurements() returns from then on.
  void setFactors(const std::vector<double>& factors, double equal);

  std::size_t size() const { return size_; }
  double dimensions() const { return dimensions_; }
  /// Effective number of measurements: the number of measurements with equal factors that would
  /// give the same variance.
  double equalMeasurements() const { return equal_; }
  /// Degrees of freedom that the fit leaves: d * equalMeasurements() - parameters, but at least 1.
  double freedom() const { return std::max(dimensions_ * equal_ - parameters_, 1.0); }
  double parameters() const { return parameters_; }

  double scale() const { return std::sqrt(scale2); }
  void setScale(double scale) { scale2 = scale * scale; }
  /// Estimates the scale from the current errors by maximum likelihood (expectation maximisation),
  /// but sets it to at least `least`. Each round divides the weighted sum of the squared errors by
  /// the sum of the weights instead of the number of measurements, because this converges faster
  /// (Kent, Tyler & Vardi 1994). After a fit the errors are smaller than the noise, especially if
  /// there are few measurements, so the scale is enlarged according to freedom().
  void estimateScale(double least);

  // The problem writes these arrays, with one entry for each measurement.
  std::vector<double> squared;  ///< squared error e² of each measurement
  std::vector<double> weight;   ///< weights w = t c at the newest state
  std::vector<double> former;   ///< weights w at the previous state
  std::vector<double> factor;   ///< factor c of each measurement
  double scale2 = 0.0;          ///< squared scale of the residuals

 private:
  std::size_t size_ = 0;
  double dimensions_ = 1.0;
  double parameters_ = 0.0;
  double equal_ = 0.0;
};

}  // namespace ktgp_orb::estimation
