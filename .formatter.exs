[
  inputs: ["{mix,.formatter}.exs", "{bench,config,examples,lib,rel,test}/**/*.{ex,exs}"]
]
