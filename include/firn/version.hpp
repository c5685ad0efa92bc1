// SPDX-License-Identifier: MIT
#pragma once

// The library's version. This is its only place: CMakeLists.txt and what it installs read it here.
#define FIRN_VERSION_MAJOR 0
#define FIRN_VERSION_MINOR 2
#define FIRN_VERSION_PATCH 0
