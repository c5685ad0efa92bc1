// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <vector>

namespace firn
{

/// Objects of any types, at most one of each. They are found by their type, and created on first use.
class ObjectsByType
{
public:
    /// The object of this type. If there is none yet, it is made of the arguments.
    template <class T, class... Arguments>
    T& of(Arguments const&... arguments)
    {
        for (Object const& object : objects_)
            if (object.type == &identity<T>) return *static_cast<T*>(object.pointer.get());
        auto const destroy = [](void* object) { delete static_cast<T*>(object); };
        objects_.push_back({&identity<T>, {new T(arguments...), destroy}});
        return *static_cast<T*>(objects_.back().pointer.get());
    }

private:
    /// Its address stands for the type, since host programs may have no RTTI.
    template <class T>
    static inline char const identity = 0;

    struct Object
    {
        void const* type;
        // std::shared_ptr<void> would add dozens of functions for each type
        std::unique_ptr<void, void (*)(void*)> pointer;
    };

    std::vector<Object> objects_;
};

} // namespace firn
