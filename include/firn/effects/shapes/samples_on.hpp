// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// A shape that is given by samples, with them on a backend: a Shape for that backend's loops. Cheap to copy.
///
/// `View` is a plain value with a pointer `values` to the samples.
template <class Backend, class View>
class SamplesOn
{
    using Number = std::remove_cvref_t<decltype(*std::declval<View>().values)>;
    using Values = typename Backend::template Array<Number>;

public:
    SamplesOn(View view, std::vector<Number> const& values, Backend const& backend)
        : view_(view), values_(std::make_shared<Values>(backend))
    {
        values_->resize(values.size());
        values_->upload(0, values);
        view_.values = values_->data();
    }

    /// Its samples where they lie; valid while the shape or a copy of it lives.
    View view() const { return view_; }

private:
    View view_;
    std::shared_ptr<Values> values_;
};

} // namespace firn
