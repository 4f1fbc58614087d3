defmodule BB.Dsl.Settings do
  @moduledoc "The words inside `settings`."

  use BB.Dsl.Vocabulary,
    fields: [
      :name,
      :topic_prefix,
      :parameter_store,
      :registry_module,
      :registry_options,
      :supervisor_module
    ]
end
