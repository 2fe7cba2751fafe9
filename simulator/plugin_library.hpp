// Opens a user's shared library that holds a speed law (plugin.h).
#pragma once

#ifndef __wasm__
#include <dlfcn.h>
#endif

#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>

#include "own_law.hpp"

namespace cogless {

#ifdef __wasm__
inline PluginLaw open_plugin(const std::string& path, const std::vector<double>&, const cogless_plugin_drive&, double, double) {
    throw std::invalid_argument(path + ": a page can't open a library");
}
#else
inline PluginLaw open_plugin(const std::string& path, std::vector<double> params, const cogless_plugin_drive& drive, double ts,
                             double current_limit) {
    void* handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (handle == nullptr) throw std::invalid_argument(dlerror());
    static const int registered = std::atexit(InLibrary::refuse_exit);
    (void)registered;
    PluginLaw law;
    law.path = path;
    law.library = std::shared_ptr<void>(handle, [](void* h) { dlclose(h); });
    const auto look_for = [&](const char* name, auto& function) {
        function = reinterpret_cast<std::decay_t<decltype(function)>>(dlsym(handle, name));
    };
    const auto find = [&](const char* name, auto& function) {
        look_for(name, function);
        if (function == nullptr) throw std::invalid_argument("the library does not export " + std::string(name));
    };
    decltype(&cogless_plugin_version) version;
    find("cogless_plugin_version", version);
    if (version() < 1U || version() > COGLESS_PLUGIN_VERSION) {
        throw std::invalid_argument("the library's plugin version is " + std::to_string(version()) + ", expected 1 to " +
                                    std::to_string(COGLESS_PLUGIN_VERSION));
    }
    find("cogless_plugin_state_size", law.state_size);
    find("cogless_plugin_init", law.init);
    find("cogless_plugin_step", law.step_function);
    look_for("cogless_plugin_begin_trial", law.begin_function);
    look_for("cogless_plugin_end_trial", law.end_function);
    look_for("cogless_plugin_design", law.design_function);
    look_for("cogless_plugin_i_q_learned", law.learned_function);
    look_for("cogless_plugin_current_step", law.current_function);
    look_for("cogless_plugin_learned_map", law.map_function);
    look_for("cogless_plugin_load_map", law.load_function);
    law.params = std::move(params);
    law.drive = drive;
    law.ts = ts;
    law.current_limit = current_limit;
    return law;
}
#endif

}  // namespace cogless
